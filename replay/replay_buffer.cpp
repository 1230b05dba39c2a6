#include "replay/replay_buffer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <sstream>
#include <stdexcept>
#include <type_traits>
#include <utility>
#include <vector>

#include "cale/fields.h"
#include "replay/accumulator.h"
#include "replay/available_memory.h"
#include "replay/lazy_array.h"
#include "replay/replay_file.h"

namespace cale {
namespace {

constexpr std::string_view kFileMagic = "CALE-RPL";
constexpr std::uint32_t kFileVersion = 1;

// One number of the configuration, under the name its user knows.
struct ConfigEntry {
    const char* key;
    double value;
    Range range;
    std::span<const std::string_view> names = {};  // of an enumeration's values

    std::string text(double number) const {
        const auto i = static_cast<std::size_t>(number);
        if (number >= 0 && i < names.size()) return std::string(names[i]);
        std::ostringstream out;
        out << number;
        return out.str();
    }
};

std::array<ConfigEntry, 9> entries(const ReplayConfig& config) {
    const auto number = [](auto value) { return static_cast<double>(value); };
    return {{{"agent.replay_capacity", number(config.capacity), {1, 1e9}},
             {"env.num_envs", number(config.num_envs), {1, 1024}},
             {"agent.stack", number(config.stack), {1, 64}},
             {"frame_height", number(config.frame_height), {1, 4096}},
             {"frame_width", number(config.frame_width), {1, 4096}},
             {"action_size", number(config.action_size), {0, 1024}},
             {"agent.update_horizon", number(config.update_horizon), {1, 10'000}},
             {"agent.gamma", config.gamma, {0, 1}},
             {"agent.replay_terminal",
              number(static_cast<int>(config.replay_terminal)),
              {0, 1},
              names_of(config.replay_terminal)}}};
}

void validate(const ReplayConfig& config) {
    for (const ConfigEntry& entry : entries(config)) {
        if (entry.value >= entry.range.low && entry.value <= entry.range.high) continue;
        std::ostringstream message;
        message << entry.key << " is " << entry.value << "; it must lie in [" << entry.range.low << ", "
                << entry.range.high << "]";
        throw std::invalid_argument(message.str());
    }
}

std::int64_t frame_size(const ReplayConfig& config) {
    return config.frame_height * config.frame_width;
}

// As many frames as there are transitions, and those of the windows that are not yet
// complete while all environments step together, a final frame with every step.
std::int64_t frame_capacity(const ReplayConfig& config) {
    return config.capacity + 2 * config.num_envs * (config.update_horizon + config.stack);
}

std::int64_t bytes_per_frame(const ReplayConfig& config) {
    const auto action = config.action_size > 0 ? config.action_size * std::int64_t{sizeof(float)}
                                               : std::int64_t{sizeof(std::int64_t)};
    return frame_size(config) + action + std::int64_t{sizeof(std::int64_t)};
}

std::int64_t bytes_per_transition(const ReplayConfig& config) {
    return 2 * config.stack * std::int64_t{sizeof(FrameId)} + 2 * std::int64_t{sizeof(float)};
}

void check_size(const char* what, std::size_t size, std::int64_t expected) {
    if (static_cast<std::int64_t>(size) != expected)
        throw std::invalid_argument(std::string(what) + " has " + std::to_string(size) +
                                    " elements; this replay stores " + std::to_string(expected));
}

void check_tensor(const char* name, const torch::Tensor& tensor, at::IntArrayRef shape, at::ScalarType type) {
    if (tensor.defined() && tensor.device().is_cpu() && tensor.is_contiguous() &&
        tensor.scalar_type() == type && tensor.sizes() == shape)
        return;
    std::ostringstream message;
    message << "batch." << name << " must be a contiguous CPU tensor " << shape << " of " << type;
    if (tensor.defined())
        message << ", not " << tensor.sizes() << " of " << tensor.scalar_type() << " on " << tensor.device();
    throw std::invalid_argument(message.str());
}

// The slots of entries [begin, end) in a ring: one or two runs.
template <class Visit>
void for_each_run(std::int64_t begin, std::int64_t end, std::int64_t capacity, const Visit& visit) {
    while (begin < end) {
        const std::int64_t slot = begin % capacity;
        const std::int64_t count = std::min(end - begin, capacity - slot);
        visit(slot, count);
        begin += count;
    }
}

struct Saving {
    ReplayFileWriter& file;
    template <class T>
    void operator()(const T* values, std::int64_t count) const {
        file.write(values, static_cast<std::size_t>(count) * sizeof(T));
    }
};

struct Loading {
    ReplayFileReader& file;
    template <class T>
    void operator()(T* values, std::int64_t count) const {
        file.read(values, static_cast<std::size_t>(count) * sizeof(T));
    }
};

static_assert(std::endian::native == std::endian::little, "replay files are little-endian");
static_assert(sizeof(StoredStep) == 16 && std::is_trivially_copyable_v<StoredStep>);

}  // namespace

// Frames and transitions lie in two rings and carry numbers that only grow; a number's
// slot is its remainder. The action of a step lies with the frame it was chosen on.
struct ReplayBuffer::Impl {
    ReplayConfig config;
    std::int64_t frame_size, frame_capacity;

    LazyArray<std::uint8_t> frames;            // [frame_capacity, H, W]
    LazyArray<float> actions;                  // [frame_capacity, action_size]
    LazyArray<std::int64_t> discrete_actions;  // [frame_capacity] if action_size is 0
    LazyArray<std::int64_t> users_end;         // [frame_capacity] last transition with this frame, plus 1
    FrameId frames_end = 0;                    // frames ever stored

    LazyArray<FrameId> references;       // [capacity, 2, stack] observation, next observation
    LazyArray<float> n_step_returns;     // [capacity]
    LazyArray<float> discounts;          // [capacity]
    std::int64_t transitions_begin = 0;  // the oldest transition that can be sampled
    std::int64_t transitions_end = 0;    // transitions ever stored

    std::vector<Accumulator> accumulators;  // one per environment

    explicit Impl(const ReplayConfig& replay_config)
        : config(replay_config),
          frame_size(cale::frame_size(config)),
          frame_capacity(cale::frame_capacity(config)),
          frames(frame_capacity * frame_size),
          actions(frame_capacity * config.action_size),
          discrete_actions(config.action_size == 0 ? frame_capacity : 0),
          users_end(frame_capacity),
          references(config.capacity * 2 * config.stack),
          n_step_returns(config.capacity),
          discounts(config.capacity),
          accumulators(static_cast<std::size_t>(config.num_envs), Accumulator(config)) {}

    FrameId frames_begin() const { return std::max<FrameId>(frames_end - frame_capacity, 0); }
    std::int64_t size() const { return transitions_end - transitions_begin; }
    std::int64_t references_per_transition() const { return 2 * config.stack; }

    FrameId push_frame(std::span<const std::uint8_t> pixels) {
        const std::int64_t slot = frames_end % frame_capacity;
        // First in, first out: with the last transition that shows the old frame, all before it go.
        transitions_begin = std::max(transitions_begin, users_end[slot]);
        users_end[slot] = 0;
        std::memcpy(frames.data() + slot * frame_size, pixels.data(), pixels.size());
        return frames_end++;
    }

    void push_action(FrameId frame, const Experience& experience) {
        const std::int64_t slot = frame % frame_capacity;
        if (config.action_size == 0)
            discrete_actions[slot] = experience.discrete_action;
        else
            std::copy(experience.action.begin(), experience.action.end(),
                      actions.data() + slot * config.action_size);
    }

    void push_transition(const Transition& transition) {
        const auto overwritten = [this](FrameId frame) {
            return frame != kBlankFrame && frame < frames_begin();
        };
        if (std::ranges::any_of(transition.observation, overwritten) ||
            std::ranges::any_of(transition.next_observation, overwritten))
            return;
        if (size() == config.capacity) ++transitions_begin;
        const std::int64_t slot = transitions_end % config.capacity;
        const auto next =
            std::ranges::copy(transition.observation, references_of(transitions_end).begin()).out;
        std::ranges::copy(transition.next_observation, next);
        n_step_returns[slot] = static_cast<float>(transition.n_step_return);
        discounts[slot] = static_cast<float>(transition.discount);
        mark_users(transitions_end++);
    }

    std::span<FrameId> references_of(std::int64_t transition) {
        const std::int64_t width = references_per_transition();
        return {references.data() + transition % config.capacity * width, static_cast<std::size_t>(width)};
    }

    void mark_users(std::int64_t transition) {
        for (const FrameId frame : references_of(transition))
            if (frame != kBlankFrame) users_end[frame % frame_capacity] = transition + 1;
    }

    void copy_stack(const FrameId* reference, std::uint8_t* pixels) const {
        const auto bytes = static_cast<std::size_t>(frame_size);
        for (std::int64_t i = 0; i < config.stack; ++i, pixels += frame_size) {
            if (reference[i] == kBlankFrame)
                std::memset(pixels, 0, bytes);
            else
                std::memcpy(pixels, frames.data() + reference[i] % frame_capacity * frame_size, bytes);
        }
    }

    void check_batch(const Batch& batch) const {
        const std::int64_t size = batch.index.defined() && batch.index.dim() == 1 ? batch.index.size(0) : 0;
        const std::array<std::int64_t, 4> stacks{size, config.stack, config.frame_height, config.frame_width};
        const std::array<std::int64_t, 2> coordinates{size, config.action_size};
        const at::IntArrayRef batch_shape(size);
        check_tensor("observation", batch.observation, stacks, at::kByte);
        check_tensor("next_observation", batch.next_observation, stacks, at::kByte);
        if (config.action_size == 0)
            check_tensor("action", batch.action, batch_shape, at::kLong);
        else
            check_tensor("action", batch.action, coordinates, at::kFloat);
        check_tensor("n_step_return", batch.n_step_return, batch_shape, at::kFloat);
        check_tensor("discount", batch.discount, batch_shape, at::kFloat);
        check_tensor("index", batch.index, batch_shape, at::kLong);
    }

    // Copies the transition at `position(i)` to row i, for every row of a batch that was checked.
    template <class Position>
    void fill(Batch& batch, const Position& position) const {
        auto* observation = batch.observation.data_ptr<std::uint8_t>();
        auto* next_observation = batch.next_observation.data_ptr<std::uint8_t>();
        auto* n_step_return = batch.n_step_return.data_ptr<float>();
        auto* discount = batch.discount.data_ptr<float>();
        auto* index = batch.index.data_ptr<std::int64_t>();
        float* action = config.action_size > 0 ? batch.action.data_ptr<float>() : nullptr;
        auto* discrete_action = config.action_size > 0 ? nullptr : batch.action.data_ptr<std::int64_t>();
        const std::int64_t stack_size = config.stack * frame_size;
        for (std::int64_t i = 0; i < batch.index.size(0); ++i) {
            const std::int64_t slot = (transitions_begin + position(i)) % config.capacity;
            const FrameId* reference = references.data() + slot * references_per_transition();
            copy_stack(reference, observation + i * stack_size);
            copy_stack(reference + config.stack, next_observation + i * stack_size);
            const std::int64_t step = reference[config.stack - 1] % frame_capacity;
            if (discrete_action != nullptr)
                discrete_action[i] = discrete_actions[step];
            else
                std::copy_n(actions.data() + step * config.action_size, config.action_size,
                            action + i * config.action_size);
            n_step_return[i] = n_step_returns[slot];
            discount[i] = discounts[slot];
            index[i] = slot;
        }
    }

    // Everything that a file holds, in its order: `exchange` writes it or reads it.
    template <class Exchange>
    void contents(const Exchange& exchange) {
        exchange(&frames_end, 1);
        exchange(&transitions_begin, 1);
        exchange(&transitions_end, 1);
        if (frames_end < 0 || transitions_begin < 0 || transitions_end < transitions_begin ||
            size() > config.capacity)
            exchange.file.fail("its counters contradict each other");

        for (Accumulator& accumulator : accumulators) {
            std::vector<StoredStep>& steps = accumulator.steps();
            auto count = static_cast<std::int64_t>(steps.size());
            exchange(&count, 1);
            if (count < 0 || count > accumulator.max_steps())
                exchange.file.fail("it holds too long a window");
            steps.resize(static_cast<std::size_t>(count));
            exchange(steps.data(), count);
        }
        for_each_run(transitions_begin, transitions_end, config.capacity, [&](auto slot, auto count) {
            const std::int64_t width = references_per_transition();
            exchange(references.data() + slot * width, count * width);
            exchange(n_step_returns.data() + slot, count);
            exchange(discounts.data() + slot, count);
        });
        for_each_run(frames_begin(), frames_end, frame_capacity, [&](auto slot, auto count) {
            if (config.action_size > 0)
                exchange(actions.data() + slot * config.action_size, count * config.action_size);
            else
                exchange(discrete_actions.data() + slot, count);
            exchange(frames.data() + slot * frame_size, count * frame_size);
        });
    }

    // Completes what contents() read, if every frame it speaks of is there.
    void restore_users(const ReplayFileReader& file) {
        for (Accumulator& accumulator : accumulators)
            for (const StoredStep& step : accumulator.steps())
                if (step.frame < 0 || step.frame >= frames_end) file.fail("a window shows a frame it lacks");
        for (std::int64_t transition = transitions_begin; transition < transitions_end; ++transition) {
            const std::span<const FrameId> shown = references_of(transition);
            const auto present = [this](FrameId frame) {
                return frame == kBlankFrame || (frame >= frames_begin() && frame < frames_end);
            };
            const auto newest = shown[static_cast<std::size_t>(config.stack) - 1];
            if (newest == kBlankFrame || !std::ranges::all_of(shown, present))
                file.fail("a transition shows a frame it lacks");
            mark_users(transition);
        }
    }
};

std::span<const std::string_view> names_of(ReplayTerminal) {
    static constexpr std::array<std::string_view, 2> names{"corrected", "dopamine"};
    return names;
}

std::int64_t memory_needed(const ReplayConfig& config) {
    validate(config);
    return frame_capacity(config) * bytes_per_frame(config) + config.capacity * bytes_per_transition(config);
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

ReplayBuffer::ReplayBuffer(const ReplayConfig& config) {
    check_memory(config, available_memory());
    impl_ = std::make_unique<Impl>(config);
}
ReplayBuffer::~ReplayBuffer() = default;
ReplayBuffer::ReplayBuffer(ReplayBuffer&&) noexcept = default;
ReplayBuffer& ReplayBuffer::operator=(ReplayBuffer&&) noexcept = default;

const ReplayConfig& ReplayBuffer::config() const {
    return impl_->config;
}
std::int64_t ReplayBuffer::size() const {
    return impl_->size();
}
std::int64_t ReplayBuffer::add_count() const {
    return impl_->transitions_end;
}

void ReplayBuffer::add(std::int64_t env, const Experience& experience) {
    Impl& replay = *impl_;
    const ReplayConfig& config = replay.config;
    if (env < 0 || env >= config.num_envs)
        throw std::out_of_range("environment " + std::to_string(env) + " of a replay for " +
                                std::to_string(config.num_envs));
    check_size("the frame", experience.frame.size(), replay.frame_size);
    if (config.action_size > 0) check_size("the action", experience.action.size(), config.action_size);
    const EpisodeEnd ending = experience.terminal    ? EpisodeEnd::terminal
                              : experience.truncated ? EpisodeEnd::truncated
                                                     : EpisodeEnd::none;
    const bool bootstraps =
        ending == EpisodeEnd::truncated && config.replay_terminal == ReplayTerminal::corrected;
    if (bootstraps)
        check_size("final_frame, needed at a truncation,", experience.final_frame.size(), replay.frame_size);

    const FrameId frame = replay.push_frame(experience.frame);
    replay.push_action(frame, experience);
    const FrameId final_frame = bootstraps ? replay.push_frame(experience.final_frame) : kBlankFrame;
    replay.accumulators[static_cast<std::size_t>(env)].add(
        {frame, experience.reward}, ending, final_frame,
        [&replay](const Transition& transition) { replay.push_transition(transition); });
}

Batch ReplayBuffer::empty_batch(std::int64_t batch_size) const {
    const ReplayConfig& config = impl_->config;
    const auto stacks = [&] {
        return torch::empty({batch_size, config.stack, config.frame_height, config.frame_width},
                            torch::kUInt8);
    };
    return {.observation = stacks(),
            .action = config.action_size > 0 ? torch::empty({batch_size, config.action_size}, torch::kFloat32)
                                             : torch::empty({batch_size}, torch::kInt64),
            .n_step_return = torch::empty({batch_size}, torch::kFloat32),
            .discount = torch::empty({batch_size}, torch::kFloat32),
            .next_observation = stacks(),
            .index = torch::empty({batch_size}, torch::kInt64)};
}

Batch ReplayBuffer::sample(std::int64_t batch_size, std::mt19937_64& random) const {
    Batch batch = empty_batch(batch_size);
    sample_into(batch, random);
    return batch;
}

void ReplayBuffer::sample_into(Batch& batch, std::mt19937_64& random) const {
    impl_->check_batch(batch);
    if (size() == 0) throw std::runtime_error("cannot sample from a replay that holds no transition yet");
    const auto size = static_cast<std::uint64_t>(impl_->size());
    const std::uint64_t rejected = (0 - size) % size;  // 2^64 mod size
    impl_->fill(batch, [&](std::int64_t) {
        std::uint64_t bits = random();
        while (bits < rejected) bits = random();
        return static_cast<std::int64_t>(bits % size);
    });
}

Batch ReplayBuffer::gather(std::span<const std::int64_t> positions) const {
    for (const std::int64_t position : positions)
        if (position < 0 || position >= size())
            throw std::out_of_range("transition " + std::to_string(position) + " of a replay that holds " +
                                    std::to_string(size()));
    Batch batch = empty_batch(static_cast<std::int64_t>(positions.size()));
    impl_->fill(batch, [&](std::int64_t i) { return positions[static_cast<std::size_t>(i)]; });
    return batch;
}

void ReplayBuffer::save(const std::string& path) const {
    ReplayFileWriter file(path, kFileMagic, kFileVersion);
    const Saving exchange{file};
    for (const ConfigEntry& entry : entries(impl_->config)) exchange(&entry.value, 1);
    impl_->contents(exchange);
    file.commit();
}

void ReplayBuffer::load(const std::string& path) {
    ReplayFileReader file(path, kFileMagic, kFileVersion);
    const Loading exchange{file};
    for (const ConfigEntry& entry : entries(impl_->config)) {
        double found = 0;
        exchange(&found, 1);
        if (found == entry.value) continue;
        file.fail(std::string("it was written with ") + entry.key + " = " + entry.text(found) +
                  ", this buffer has " + entry.text(entry.value));
    }
    auto loaded = std::make_unique<Impl>(impl_->config);
    loaded->contents(exchange);
    file.finish();
    loaded->restore_users(file);
    impl_ = std::move(loaded);
}

}  // namespace cale
