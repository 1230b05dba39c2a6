// Gradient steps as CUDA graphs.
#include "agents/captured_update.h"

#include <utility>

#include <ATen/cuda/CUDAGraph.h>
#include <c10/core/Event.h>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>

namespace cale {
namespace {

/// The first runs choose algorithms and take memory, which a recording must not.
constexpr int kRunsBeforeRecording = 3;

/// What comes on `later` from now on waits for what is on `earlier` now.
void make_wait(const c10::cuda::CUDAStream& later, const c10::cuda::CUDAStream& earlier) {
    c10::Event event(c10::DeviceType::CUDA);
    event.record(earlier);
    event.block(later);
}

}  // namespace

struct CapturedUpdate::Impl {
    Impl(c10::Device device, at::Generator drawn_from)
        : stream(c10::cuda::getStreamFromPool(/*isHighPriority=*/false, device.index())),
          generator(std::move(drawn_from)) {}

    /// On the stream of the recording, as LibTorch's autograd remembers where gradients were first made.
    void run_by_kernel(const std::function<void()>& update) {
        const auto caller = c10::cuda::getCurrentCUDAStream(stream.device_index());
        make_wait(stream, caller);
        {
            const c10::cuda::CUDAStreamGuard on_stream(stream);
            update();
        }
        make_wait(caller, stream);
    }

    void record(const std::function<void()>& update) {
        auto recording = std::make_unique<at::cuda::CUDAGraph>();
        if (generator.defined()) recording->register_generator_state(generator);
        const c10::cuda::CUDAStreamGuard on_stream(stream);
        c10::cuda::device_synchronize();  // the stream's device, which may not be the caller's
        recording->capture_begin();
        try {
            update();
        } catch (...) {
            try {
                recording->capture_end();  // or the stream would stay in capture
            } catch (...) {  // NOLINT(bugprone-empty-catch): the first error says what went wrong
            }
            throw;
        }
        recording->capture_end();
        graph = std::move(recording);
    }

    c10::cuda::CUDAStream stream;
    at::Generator generator;
    int runs = 0;
    std::unique_ptr<at::cuda::CUDAGraph> graph;
};

CapturedUpdate::CapturedUpdate(c10::Device device, at::Generator generator) {
    if (device.is_cuda()) impl_ = std::make_unique<Impl>(device, std::move(generator));
}
CapturedUpdate::~CapturedUpdate() = default;

void CapturedUpdate::operator()(const std::function<void()>& update) {
    if (!impl_) return update();
    if (impl_->runs < kRunsBeforeRecording) {
        ++impl_->runs;
        return impl_->run_by_kernel(update);
    }
    if (!impl_->graph) impl_->record(update);  // records, and does not run
    impl_->graph->replay();
}

void CapturedUpdate::forget() {
    if (impl_) impl_->graph.reset();
}

}  // namespace cale
