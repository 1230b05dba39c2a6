#include "replay/replay_buffer.h"

#include <algorithm>
#include <array>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "replay/config_entries.h"

namespace cale {
namespace {

void check_size(const char* what, std::size_t size, std::int64_t expected) {
    if (static_cast<std::int64_t>(size) != expected)
        throw std::invalid_argument(std::string(what) + " has " + std::to_string(size) +
                                    " elements; this replay stores " + std::to_string(expected));
}

void check_tensor(const char* name, const torch::Tensor& tensor, at::IntArrayRef shape, at::ScalarType type,
                  torch::Device device = torch::kCPU) {
    if (tensor.defined() && tensor.device() == device && tensor.is_contiguous() &&
        tensor.scalar_type() == type && tensor.sizes() == shape)
        return;
    std::ostringstream message;
    message << name << " must be a contiguous " << device << " tensor " << shape << " of " << type;
    if (tensor.defined())
        message << ", not " << tensor.sizes() << " of " << tensor.scalar_type() << " on " << tensor.device();
    throw std::invalid_argument(message.str());
}

std::int64_t rows_of(const torch::Tensor& index) {
    return index.defined() && index.dim() == 1 ? index.size(0) : 0;
}

}  // namespace

ReplayBuffer::ReplayBuffer(const ReplayConfig& config, std::optional<torch::Device> mirror)
    : config_(config) {
    validate(config);
    ring_ = std::make_unique<FrameRing>(config);
    accumulators_.assign(static_cast<std::size_t>(config.num_envs), Accumulator(config));
    if (config.prioritised) priorities_.emplace(config.capacity);
    if (mirror) mirror_ = std::make_unique<FrameMirror>(config, *mirror);
}

void ReplayBuffer::add(std::int64_t env, const Experience& experience) {
    if (env < 0 || env >= config_.num_envs)
        throw std::out_of_range("environment " + std::to_string(env) + " of a replay for " +
                                std::to_string(config_.num_envs));
    check_size("the frame", experience.frame.size(), ring_->frame_size);
    if (config_.action_size > 0) check_size("the action", experience.action.size(), config_.action_size);
    const EpisodeEnd ending = experience.terminal    ? EpisodeEnd::terminal
                              : experience.truncated ? EpisodeEnd::truncated
                                                     : EpisodeEnd::none;
    const bool bootstraps =
        ending == EpisodeEnd::truncated && config_.replay_terminal == ReplayTerminal::corrected;
    if (bootstraps)
        check_size("final_frame, needed at a truncation,", experience.final_frame.size(), ring_->frame_size);

    const std::int64_t begin = ring_->transitions_begin, end = ring_->transitions_end;
    const FrameId frame = ring_->push_frame(experience.frame);
    ring_->push_action(frame, experience);
    const FrameId final_frame = bootstraps ? ring_->push_frame(experience.final_frame) : kBlankFrame;
    accumulators_[static_cast<std::size_t>(env)].add(
        {frame, experience.reward}, ending, final_frame,
        [this](const Transition& transition) { ring_->push_transition(transition); });
    if (priorities_) follow_ring(begin, end);
}

Batch ReplayBuffer::empty_batch(std::int64_t batch_size) const {
    const auto stacks = [&] {
        return torch::empty(config_.observation.tensor_shape({batch_size}),
                            torch::dtype(torch::kUInt8).device(pixels_device()));
    };
    return {.observation = stacks(),
            .action = config_.action_size > 0
                          ? torch::empty({batch_size, config_.action_size}, torch::kFloat32)
                          : torch::empty({batch_size}, torch::kInt64),
            .n_step_return = torch::empty({batch_size}, torch::kFloat32),
            .discount = torch::empty({batch_size}, torch::kFloat32),
            .next_observation = stacks(),
            .index = torch::empty({batch_size}, torch::kInt64),
            .probability = torch::empty({batch_size}, torch::kFloat32)};
}

Batch ReplayBuffer::sample(std::int64_t batch_size, std::mt19937_64& random) const {
    Batch batch = empty_batch(batch_size);
    sample_into(batch, random);
    return batch;
}

void ReplayBuffer::sample_into(Batch& batch, std::mt19937_64& random) const {
    require_shapes(batch);
    if (size() == 0) throw std::runtime_error("cannot sample from a replay that holds no transition yet");
    if (draws_by_priority())
        sample_by_priority(batch, random);
    else
        sample_uniformly(batch, random);
    if (mirror_) mirror_->gather(*ring_, batch);
}

Batch ReplayBuffer::gather(std::span<const std::int64_t> positions) const {
    Batch batch = empty_batch(static_cast<std::int64_t>(positions.size()));
    std::int64_t row = 0;
    for (const std::int64_t position : positions) {
        if (position < 0 || position >= size())
            throw std::out_of_range("transition " + std::to_string(position) + " of a replay that holds " +
                                    std::to_string(size()));
        copy(position, batch, row++);
    }
    if (mirror_ && row > 0) mirror_->gather(*ring_, batch);
    return batch;
}

void ReplayBuffer::set_priorities(const torch::Tensor& index, const torch::Tensor& priority) {
    if (!priorities_) throw std::logic_error("priorities for a replay that samples uniformly");
    const std::int64_t count = rows_of(index);
    const auto type = priority.defined() && priority.scalar_type() == at::kDouble ? at::kDouble : at::kFloat;
    check_tensor("index", index, count, at::kLong);
    check_tensor("priority", priority, count, type);
    const torch::Tensor as_double = priority.to(at::kDouble);
    const auto* slots = index.const_data_ptr<std::int64_t>();
    const auto* values = as_double.const_data_ptr<double>();
    for (std::int64_t i = 0; i < count; ++i) {
        if (slots[i] < 0 || slots[i] >= config().capacity)
            throw std::out_of_range("index " + std::to_string(slots[i]) + " of a replay with a capacity of " +
                                    std::to_string(config().capacity));
        if (values[i] >= 0 && values[i] <= kMaxPriority) continue;
        std::ostringstream message;
        message << "the priority of index " << slots[i] << " is " << values[i] << "; it must lie in [0, "
                << kMaxPriority << "]";
        throw std::invalid_argument(message.str());
    }
    // Backwards: of one index, the first occurrence has the last word.
    for (std::int64_t i = count; i-- > 0;) {
        if (position_of(slots[i]) >= size()) continue;
        priorities_->set(slots[i], values[i]);
        largest_priority_ = std::max(largest_priority_, values[i]);
    }
}

ReplayState ReplayBuffer::state() const {
    ReplayState state{.frames_end = ring_->frames_end,
                      .transitions_begin = ring_->transitions_begin,
                      .transitions_end = ring_->transitions_end};
    for (const Accumulator& accumulator : accumulators_) state.windows.push_back(accumulator.steps());
    if (!priorities_) return state;
    const auto values = std::as_const(*priorities_).values();
    state.priorities.assign(values.begin(), values.end());
    state.largest_priority = largest_priority_;
    return state;
}

void ReplayBuffer::restore(std::unique_ptr<FrameRing> ring, ReplayState state) {
    if (ring_->is_held()) throw std::logic_error("a replay is loaded while a snapshot of it is read");
    ring_ = std::move(ring);
    for (std::size_t i = 0; i < accumulators_.size(); ++i)
        accumulators_[i].steps() = std::move(state.windows[i]);
    if (mirror_) mirror_->forget();
    if (!priorities_) return;
    largest_priority_ = state.largest_priority;
    std::ranges::copy(state.priorities, priorities_->values().begin());
    priorities_->restore_sums();
}

// Sampling ----------------------------------------------------------------------------

void ReplayBuffer::require_shapes(const Batch& batch) const {
    const std::int64_t size = rows_of(batch.index);
    const auto stacks = config_.observation.tensor_shape({size});
    const std::array<std::int64_t, 2> coordinates{size, config_.action_size};
    const at::IntArrayRef batch_shape(size);
    check_tensor("batch.observation", batch.observation, stacks, at::kByte, pixels_device());
    check_tensor("batch.next_observation", batch.next_observation, stacks, at::kByte, pixels_device());
    if (config_.action_size == 0)
        check_tensor("batch.action", batch.action, batch_shape, at::kLong);
    else
        check_tensor("batch.action", batch.action, coordinates, at::kFloat);
    check_tensor("batch.n_step_return", batch.n_step_return, batch_shape, at::kFloat);
    check_tensor("batch.discount", batch.discount, batch_shape, at::kFloat);
    check_tensor("batch.index", batch.index, batch_shape, at::kLong);
    check_tensor("batch.probability", batch.probability, batch_shape, at::kFloat);
}

// Of what lies in this slot, 0 being the oldest; size() or more if nothing does.
std::int64_t ReplayBuffer::position_of(std::int64_t slot) const {
    return (slot + config_.capacity - ring_->transitions_begin % config_.capacity) % config_.capacity;
}

// With which sampling draws the transition at this position.
double ReplayBuffer::probability(std::int64_t position) const {
    if (!draws_by_priority()) return 1.0 / static_cast<double>(ring_->size());
    const std::int64_t slot = (ring_->transitions_begin + position) % config_.capacity;
    return priorities_->get(slot) / priorities_->total();
}

// Row `row` of a batch of the right shapes: the transition at this position. A mirror adds the pixels when
// all rows are there.
void ReplayBuffer::copy(std::int64_t position, Batch& batch, std::int64_t row) const {
    const std::int64_t transition = ring_->transitions_begin + position;
    mirror_ ? ring_->copy_values(transition, batch, row) : ring_->copy(transition, batch, row);
    batch.probability.data_ptr<float>()[row] = static_cast<float>(probability(position));
}

void ReplayBuffer::sample_uniformly(Batch& batch, std::mt19937_64& random) const {
    const std::int64_t rows = batch.index.size(0);
    const auto size = static_cast<std::uint64_t>(ring_->size());
    const std::uint64_t rejected = (0 - size) % size;  // 2^64 mod size
    for (std::int64_t row = 0; row < rows; ++row) {
        std::uint64_t bits = random();
        while (bits < rejected) bits = random();
        copy(static_cast<std::int64_t>(bits % size), batch, row);
    }
}

void ReplayBuffer::sample_by_priority(Batch& batch, std::mt19937_64& random) const {
    const double total = priorities_->total();
    for (std::int64_t row = 0; row < batch.index.size(0); ++row) {
        const double uniform = static_cast<double>(random() >> 11) * 0x1p-53;
        copy(position_of(priorities_->find(uniform * total)), batch, row);
    }
}

// The ring held the transitions [begin, end) until now. In this order: a new one may lie
// where a dropped one was.
void ReplayBuffer::follow_ring(std::int64_t begin, std::int64_t end) {
    for (std::int64_t dropped = begin; dropped < ring_->transitions_begin; ++dropped)
        priorities_->set(dropped % config_.capacity, 0);
    for (std::int64_t added = end; added < ring_->transitions_end; ++added)
        priorities_->set(added % config_.capacity, largest_priority_);
}

std::unique_ptr<Replay> make_replay(const ReplayConfig& config, std::optional<torch::Device> mirror) {
    return std::make_unique<ReplayBuffer>(config, mirror);
}

}  // namespace cale
