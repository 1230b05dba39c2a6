#include "replay/frame_mirror.h"

#include <algorithm>
#include <cstring>
#include <sstream>
#include <stdexcept>
#include <string_view>

#include <c10/core/impl/VirtualGuardImpl.h>
#include <torch/types.h>

namespace cale {
namespace {

constexpr std::int64_t kStagedFrames = 64;

/// Memory that a device other than the CPU reads while the host continues.
torch::Tensor on_host(at::IntArrayRef shape, at::ScalarType type, torch::Device read_by) {
    return torch::empty(shape, torch::dtype(type).pinned_memory(!read_by.is_cpu()));
}

torch::Tensor frames_on(const ReplayConfig& config, torch::Device device) {
    const auto count = frame_capacity(config) + 1, size = config.observation.frame_size();
    try {
        auto frames = torch::empty({count, size}, torch::dtype(torch::kUInt8).device(device));
        frames[-1].zero_();
        return frames;
    } catch (const c10::Error& error) {
        // As is_out_of_memory() of terminal/failure.h, which lies above, tells it.
        const std::string_view text(error.what());
        if (text.find("out of memory") == text.npos && text.find("can't allocate memory") == text.npos) throw;
        std::ostringstream message;
        message.precision(3);
        message << "agent.replay_on_device: " << device << " lacks the memory for the replay's frames, "
                << static_cast<double>(count * size) / 1e9 << " GB: lower agent.replay_capacity from "
                << config.capacity << ", or set agent.replay_on_device to false";
        throw std::runtime_error(message.str());
    }
}

}  // namespace

FrameMirror::FrameMirror(const ReplayConfig& config, torch::Device device)
    : frames_(frames_on(config, device)),
      staged_(on_host({kStagedFrames, frames_.size(1)}, torch::kUInt8, device)),
      read_(device.type()) {}

void FrameMirror::gather(const FrameRing& ring, Batch& batch) {
    follow(ring);
    const auto rows = batch.index.size(0), depth = ring.stack;
    if (!shown_.defined() || shown_.size(1) != rows) {
        shown_ = on_host({2, rows, depth}, torch::kInt64, device());
        shown_on_device_ = torch::empty({2, rows * depth}, torch::dtype(torch::kInt64).device(device()));
    }
    wait_until_read();
    const auto* slots = batch.index.const_data_ptr<std::int64_t>();
    auto* shown = shown_.data_ptr<std::int64_t>();
    const auto blank = ring.frames_capacity;
    for (std::int64_t row = 0; row < rows; ++row) {
        const auto frames = ring.frames_of(slots[row]);  // a slot stands for any number that lies in it
        for (std::int64_t i = 0; i < 2 * depth; ++i) {
            const auto frame = frames[static_cast<std::size_t>(i)];
            shown[(i / depth * rows + row) * depth + i % depth] =
                frame == kBlankFrame ? blank : frame % ring.frames_capacity;
        }
    }
    shown_on_device_.copy_(shown_.view_as(shown_on_device_), /*non_blocking=*/true);
    record_read();
    auto observation = batch.observation.view({rows * depth, -1});
    auto next_observation = batch.next_observation.view({rows * depth, -1});
    at::index_select_out(observation, frames_, 0, shown_on_device_[0]);
    at::index_select_out(next_observation, frames_, 0, shown_on_device_[1]);
}

void FrameMirror::follow(const FrameRing& ring) {
    const auto size = ring.frame_size;
    const auto copy_run = [&](std::int64_t slot, std::int64_t count) {
        for (std::int64_t done = 0; done < count; done += kStagedFrames) {
            const auto part = std::min(kStagedFrames, count - done);
            wait_until_read();
            std::memcpy(staged_.data_ptr<std::uint8_t>(), ring.frames.data() + (slot + done) * size,
                        static_cast<std::size_t>(part * size));
            frames_.narrow(0, slot + done, part).copy_(staged_.narrow(0, 0, part), /*non_blocking=*/true);
            record_read();
        }
    };
    for_each_run(std::max(seen_, ring.frames_begin()), ring.frames_end, ring.frames_capacity, copy_run);
    seen_ = ring.frames_end;
}

void FrameMirror::wait_until_read() {
    if (read_.was_marked_for_recording()) read_.synchronize();
}

void FrameMirror::record_read() {
    if (!device().is_cpu()) read_.record(c10::impl::VirtualGuardImpl(device().type()).getStream(device()));
}

}  // namespace cale
