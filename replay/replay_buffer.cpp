#include "replay/replay_buffer.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>
#include <vector>

#include "replay/accumulator.h"
#include "replay/available_memory.h"
#include "replay/frame_mirror.h"
#include "replay/replay_config.h"
#include "replay/replay_snapshot.h"
#include "replay/replay_storage.h"
#include "replay/sum_tree.h"

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

struct ReplayBuffer::Impl {
    ReplayConfig config;
    ReplayStorage storage;
    std::vector<Accumulator> accumulators;  // one per environment
    std::optional<SumTree> priorities;      // if prioritised: of each slot, 0 where nothing lies
    double largest_priority = 1;            // that was ever given
    std::unique_ptr<FrameMirror> mirror;    // or none

    explicit Impl(const ReplayConfig& replay_config)
        : config(replay_config),
          storage(config),
          accumulators(static_cast<std::size_t>(config.num_envs), Accumulator(config)) {
        if (config.prioritised) priorities.emplace(config.capacity);
    }

    void check_batch(const Batch& batch) const {
        const std::int64_t size = rows_of(batch.index);
        const std::array<std::int64_t, 4> stacks{size, config.stack, config.frame_height, config.frame_width};
        const std::array<std::int64_t, 2> coordinates{size, config.action_size};
        const at::IntArrayRef batch_shape(size);
        check_tensor("batch.observation", batch.observation, stacks, at::kByte, pixels_device());
        check_tensor("batch.next_observation", batch.next_observation, stacks, at::kByte, pixels_device());
        if (config.action_size == 0)
            check_tensor("batch.action", batch.action, batch_shape, at::kLong);
        else
            check_tensor("batch.action", batch.action, coordinates, at::kFloat);
        check_tensor("batch.n_step_return", batch.n_step_return, batch_shape, at::kFloat);
        check_tensor("batch.discount", batch.discount, batch_shape, at::kFloat);
        check_tensor("batch.index", batch.index, batch_shape, at::kLong);
        check_tensor("batch.probability", batch.probability, batch_shape, at::kFloat);
    }

    // Of what lies in this slot, 0 being the oldest; size() or more if nothing does.
    std::int64_t position_of(std::int64_t slot) const {
        return (slot + config.capacity - storage.transitions_begin % config.capacity) % config.capacity;
    }

    // With which sampling draws the transition at this position.
    double probability(std::int64_t position) const {
        if (!priorities) return 1.0 / static_cast<double>(storage.size());
        const std::int64_t slot = (storage.transitions_begin + position) % config.capacity;
        return priorities->total() > 0 ? priorities->get(slot) / priorities->total() : 0.0;
    }

    torch::Device pixels_device() const { return mirror ? mirror->device() : torch::kCPU; }

    // Row `row` of a batch of the right shapes: the transition at this position. A mirror adds the pixels
    // when all rows are there.
    void copy_transition(std::int64_t position, Batch& batch, std::int64_t row) const {
        if (mirror)
            storage.copy_values(storage.transitions_begin + position, batch, row);
        else
            storage.copy(storage.transitions_begin + position, batch, row);
    }

    void copy(std::int64_t position, Batch& batch, std::int64_t row) const {
        copy_transition(position, batch, row);
        batch.probability.data_ptr<float>()[row] = static_cast<float>(probability(position));
    }

    void sample_uniformly(Batch& batch, std::mt19937_64& random) const {
        const std::int64_t rows = batch.index.size(0);
        const auto size = static_cast<std::uint64_t>(storage.size());
        const std::uint64_t rejected = (0 - size) % size;  // 2^64 mod size
        for (std::int64_t row = 0; row < rows; ++row) {
            std::uint64_t bits = random();
            while (bits < rejected) bits = random();
            copy_transition(static_cast<std::int64_t>(bits % size), batch, row);
        }
        // At once, as it is the same for all.
        std::fill_n(batch.probability.data_ptr<float>(), rows, static_cast<float>(probability(0)));
    }

    void sample_by_priority(Batch& batch, std::mt19937_64& random) const {
        const double total = priorities->total();
        if (total == 0) throw std::runtime_error("cannot sample from a replay whose priorities are all 0");
        for (std::int64_t row = 0; row < batch.index.size(0); ++row) {
            const double uniform = static_cast<double>(random() >> 11) * 0x1p-53;
            copy(position_of(priorities->find(uniform * total)), batch, row);
        }
    }

    // The storage held the transitions [begin, end) until now. In this order: a new one may lie
    // where a dropped one was.
    void follow_storage(std::int64_t begin, std::int64_t end) {
        for (std::int64_t dropped = begin; dropped < storage.transitions_begin; ++dropped)
            priorities->set(dropped % config.capacity, 0);
        for (std::int64_t added = end; added < storage.transitions_end; ++added)
            priorities->set(added % config.capacity, largest_priority);
    }

    ReplayState state() const {
        ReplayState state{.frames_end = storage.frames_end,
                          .transitions_begin = storage.transitions_begin,
                          .transitions_end = storage.transitions_end};
        for (const Accumulator& accumulator : accumulators) state.windows.push_back(accumulator.steps());
        if (!priorities) return state;
        const auto values = std::as_const(*priorities).values();
        state.priorities.assign(values.begin(), values.end());
        state.largest_priority = largest_priority;
        return state;
    }

    // Takes in the state that belongs to what the storage holds.
    void restore(ReplayState&& state) {
        for (std::size_t i = 0; i < accumulators.size(); ++i)
            accumulators[i].steps() = std::move(state.windows[i]);
        if (!priorities) return;
        largest_priority = state.largest_priority;
        std::ranges::copy(state.priorities, priorities->values().begin());
        priorities->restore_sums();
    }
};

std::span<const std::string_view> names_of(ReplayTerminal) {
    static constexpr std::array<std::string_view, 2> names{"corrected", "dopamine"};
    return names;
}

std::int64_t memory_needed(const ReplayConfig& config) {
    validate(config);
    return frame_capacity(config) * bytes_per_frame(config) + config.capacity * bytes_per_transition(config) +
           (config.prioritised ? SumTree::bytes(config.capacity) : 0);
}

void check_memory(const ReplayConfig& config, std::int64_t available) {
    const std::int64_t needed = memory_needed(config);
    if (needed <= available) return;
    const std::int64_t fits =
        config.capacity - (needed - available) / (bytes_per_frame(config) + bytes_per_transition(config)) - 1;
    std::ostringstream message;
    message.precision(3);
    message << "the replay needs " << static_cast<double>(needed) / 1e9 << " GB of memory and "
            << static_cast<double>(available) / 1e9 << " GB are available: lower agent.replay_capacity from "
            << config.capacity;
    if (fits > 0) message << " to " << fits << " or less";
    throw std::runtime_error(message.str());
}

ReplayBuffer::ReplayBuffer(const ReplayConfig& config, std::optional<torch::Device> mirror) {
    check_memory(config, available_memory());
    impl_ = std::make_unique<Impl>(config);
    if (mirror) impl_->mirror = std::make_unique<FrameMirror>(config, *mirror);
}
ReplayBuffer::~ReplayBuffer() = default;
ReplayBuffer::ReplayBuffer(ReplayBuffer&&) noexcept = default;
ReplayBuffer& ReplayBuffer::operator=(ReplayBuffer&&) noexcept = default;

const ReplayConfig& ReplayBuffer::config() const {
    return impl_->config;
}

std::int64_t ReplayBuffer::size() const {
    return impl_->storage.size();
}
std::int64_t ReplayBuffer::add_count() const {
    return impl_->storage.transitions_end;
}

void ReplayBuffer::add(std::int64_t env, const Experience& experience) {
    Impl& replay = *impl_;
    const ReplayConfig& config = replay.config;
    if (env < 0 || env >= config.num_envs)
        throw std::out_of_range("environment " + std::to_string(env) + " of a replay for " +
                                std::to_string(config.num_envs));
    check_size("the frame", experience.frame.size(), replay.storage.frame_size);
    if (config.action_size > 0) check_size("the action", experience.action.size(), config.action_size);
    const EpisodeEnd ending = experience.terminal    ? EpisodeEnd::terminal
                              : experience.truncated ? EpisodeEnd::truncated
                                                     : EpisodeEnd::none;
    const bool bootstraps =
        ending == EpisodeEnd::truncated && config.replay_terminal == ReplayTerminal::corrected;
    if (bootstraps)
        check_size("final_frame, needed at a truncation,", experience.final_frame.size(),
                   replay.storage.frame_size);

    ReplayStorage& storage = replay.storage;
    const std::int64_t begin = storage.transitions_begin, end = storage.transitions_end;
    const FrameId frame = storage.push_frame(experience.frame);
    storage.push_action(frame, experience);
    const FrameId final_frame = bootstraps ? storage.push_frame(experience.final_frame) : kBlankFrame;
    replay.accumulators[static_cast<std::size_t>(env)].add(
        {frame, experience.reward}, ending, final_frame,
        [&storage](const Transition& transition) { storage.push_transition(transition); });
    if (replay.priorities) replay.follow_storage(begin, end);
}

Batch ReplayBuffer::empty_batch(std::int64_t batch_size) const {
    const ReplayConfig& config = impl_->config;
    const auto stacks = [&] {
        return torch::empty({batch_size, config.stack, config.frame_height, config.frame_width},
                            torch::dtype(torch::kUInt8).device(impl_->pixels_device()));
    };
    return {.observation = stacks(),
            .action = config.action_size > 0 ? torch::empty({batch_size, config.action_size}, torch::kFloat32)
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
    impl_->check_batch(batch);
    if (size() == 0) throw std::runtime_error("cannot sample from a replay that holds no transition yet");
    if (impl_->priorities)
        impl_->sample_by_priority(batch, random);
    else
        impl_->sample_uniformly(batch, random);
    if (impl_->mirror) impl_->mirror->gather(impl_->storage, batch);
}

Batch ReplayBuffer::gather(std::span<const std::int64_t> positions) const {
    Batch batch = empty_batch(static_cast<std::int64_t>(positions.size()));
    std::int64_t row = 0;
    for (const std::int64_t position : positions) {
        if (position < 0 || position >= size())
            throw std::out_of_range("transition " + std::to_string(position) + " of a replay that holds " +
                                    std::to_string(size()));
        impl_->copy(position, batch, row++);
    }
    if (impl_->mirror) impl_->mirror->gather(impl_->storage, batch);
    return batch;
}

void ReplayBuffer::set_priorities(const torch::Tensor& index, const torch::Tensor& priority) {
    if (!impl_->priorities) throw std::logic_error("priorities for a replay that samples uniformly");
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
        if (impl_->position_of(slots[i]) >= size()) continue;
        impl_->priorities->set(slots[i], values[i]);
        impl_->largest_priority = std::max(impl_->largest_priority, values[i]);
    }
}

ReplaySnapshot ReplayBuffer::snapshot() {
    return {impl_->config, impl_->storage, impl_->state()};
}

void ReplayBuffer::save(const std::filesystem::path& folder) {
    snapshot().save(folder);
}

void ReplayBuffer::load(const std::filesystem::path& folder) {
    if (impl_->storage.is_held()) throw std::logic_error("a replay is loaded while a snapshot of it is read");
    auto loaded = std::make_unique<Impl>(impl_->config);
    loaded->restore(load_replay(folder, loaded->config, loaded->storage));
    loaded->mirror = std::move(impl_->mirror);
    if (loaded->mirror) loaded->mirror->forget();
    impl_ = std::move(loaded);
}

}  // namespace cale
