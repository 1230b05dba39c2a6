#include "replay/replay_snapshot.h"

#include <algorithm>
#include <bit>
#include <iomanip>
#include <sstream>
#include <stdexcept>
#include <string_view>
#include <type_traits>
#include <utility>

#include "replay/config_entries.h"
#include "replay/replay_file.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr std::uint32_t kVersion = 3;
constexpr const char* kStateFile = "replay.zst";
constexpr std::string_view kStateMagic = "CALE-RPL";

static_assert(std::endian::native == std::endian::little, "replay files are little-endian");
static_assert(sizeof(StoredStep) == 16 && std::is_trivially_copyable_v<StoredStep>);

/// One of the two things that come in chunks, as it lies in a ring of `capacity` slots.
struct Ring {
    const char* name;
    std::string_view magic;
    std::int64_t capacity;

    /// Large enough that there are few files; small enough that the one that is not full is soon written.
    std::int64_t chunk_size() const { return std::clamp<std::int64_t>(capacity / 16, 4, 16'384); }
};
Ring frames_ring(const FrameRing& ring) {
    return {"frames", "CALE-FRM", ring.frames_capacity};
}
Ring transitions_ring(const FrameRing& ring) {
    return {"transitions", "CALE-TRN", ring.capacity};
}

/// The numbers [begin, end): those of chunk `index` that are there. `full`: no later ones belong to it.
struct Chunk {
    std::int64_t index, begin, end;
    bool full;
};

std::string file_name(const Ring& ring, const Chunk& chunk) {
    if (!chunk.full) return std::string(ring.name) + "-open.zst";
    std::ostringstream name;
    name << ring.name << '-' << std::setw(6) << std::setfill('0') << chunk.index << ".zst";
    return name.str();
}

template <class Visit>
void for_each_chunk(std::int64_t begin, std::int64_t end, std::int64_t size, const Visit& visit) {
    while (begin < end) {
        const std::int64_t index = begin / size, next = (index + 1) * size;
        visit(Chunk{index, begin, std::min(end, next), next <= end});
        begin = next;
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

/// What replay.zst holds behind the configuration, in its order: `exchange` writes it or reads it.
template <class Exchange>
void exchange_state(ReplayState& state, const ReplayConfig& config, const Exchange& exchange) {
    exchange(&state.frames_end, 1);
    exchange(&state.transitions_begin, 1);
    exchange(&state.transitions_end, 1);
    const std::int64_t longest = Accumulator(config).max_steps();
    state.windows.resize(static_cast<std::size_t>(config.num_envs));
    for (auto& window : state.windows) {
        auto count = static_cast<std::int64_t>(window.size());
        exchange(&count, 1);
        if (count < 0 || count > longest) exchange.file.fail("it holds too long a window");
        window.resize(static_cast<std::size_t>(count));
        exchange(window.data(), count);
    }
    if (!config.prioritised) return;
    exchange(&state.largest_priority, 1);
    state.priorities.resize(static_cast<std::size_t>(config.capacity));
    exchange(state.priorities.data(), config.capacity);
}

void require_same_configuration(const ReplayConfig& config, ReplayFileReader& file) {
    for (const ReplayConfigEntry& entry : entries(config)) {
        double found = 0;
        file.read(&found, sizeof found);
        if (found == entry.value) continue;
        file.fail(std::string("it was written with ") + entry.key + " = " + entry.text(found) +
                  ", this buffer has " + entry.text(entry.value));
    }
}

bool counters_are_possible(const ReplayState& state, const ReplayConfig& config) {
    constexpr std::int64_t most = std::int64_t{1} << 60;  // so that sums with them cannot overflow
    return state.frames_end >= 0 && state.frames_end <= most && state.transitions_begin >= 0 &&
           state.transitions_end <= most && state.transitions_end >= state.transitions_begin &&
           state.transitions_end - state.transitions_begin <= config.capacity;
}

bool windows_are_possible(const ReplayState& state) {
    return std::ranges::all_of(state.windows, [&](const std::vector<StoredStep>& window) {
        return std::ranges::all_of(
            window, [&](const StoredStep& step) { return step.frame >= 0 && step.frame < state.frames_end; });
    });
}

bool priorities_are_possible(const ReplayState& state) {
    if (!(state.largest_priority >= 1 && state.largest_priority <= kMaxPriority)) return false;
    const auto capacity = std::ssize(state.priorities);
    for (std::int64_t slot = 0; slot < capacity; ++slot) {
        const std::int64_t position = (slot + capacity - state.transitions_begin % capacity) % capacity;
        const bool used = position < state.transitions_end - state.transitions_begin;
        const double priority = state.priorities[static_cast<std::size_t>(slot)];
        if (!(priority >= 0 && priority <= (used ? state.largest_priority : 0))) return false;
    }
    return true;
}

/// `for_each_array(visit)`: see FrameRing.
template <class ForEachArray>
void save_chunk(const fs::path& path, const Ring& ring, const Chunk& chunk,
                const ForEachArray& for_each_array) {
    ReplayFileWriter file(path.string(), ring.magic, kVersion);
    const Saving saving{file};
    saving(&chunk.begin, 1);
    saving(&chunk.end, 1);
    for_each_array([&](const auto* values, std::int64_t each) {
        for_each_run(chunk.begin, chunk.end, ring.capacity, [&](std::int64_t slot, std::int64_t count) {
            saving(values + slot * each, count * each);
        });
    });
    file.commit();
}

/// The file may begin earlier than the chunk: it is then from before its oldest numbers were overwritten.
template <class ForEachArray>
void load_chunk(const fs::path& path, const Ring& ring, const Chunk& chunk,
                const ForEachArray& for_each_array) {
    ReplayFileReader file(path.string(), ring.magic, kVersion);
    const Loading loading{file};
    std::int64_t begin = 0, end = 0;
    loading(&begin, 1);
    loading(&end, 1);
    if (begin < chunk.index * ring.chunk_size() || begin > chunk.begin || end != chunk.end)
        file.fail("it holds other " + std::string(ring.name) + " than the rest needs");
    for_each_array([&](auto* values, std::int64_t each) {
        file.skip(static_cast<std::size_t>((chunk.begin - begin) * each) * sizeof *values);
        for_each_run(chunk.begin, chunk.end, ring.capacity, [&](std::int64_t slot, std::int64_t count) {
            loading(values + slot * each, count * each);
        });
    });
    file.finish();
}

template <class ForEachArray>
void save_chunks(const fs::path& folder, const Ring& ring, std::int64_t begin, std::int64_t end, Hold& hold,
                 const ReplaySnapshot::TakeOver& take_over, const ForEachArray& for_each_array) {
    for_each_chunk(begin, end, ring.chunk_size(), [&](const Chunk& chunk) {
        hold.from(chunk.begin);
        const auto file = file_name(ring, chunk);
        if (chunk.full && take_over && take_over(file)) return;
        save_chunk(folder / file, ring, chunk, for_each_array);
    });
}

}  // namespace

void ReplaySnapshot::Release::operator()(FrameRing* ring) const {
    ring->held_transitions.release();
    ring->held_frames.release();  // from here on there may be another snapshot, which has holds of its own
}

ReplaySnapshot::ReplaySnapshot(Replay& replay)
    : config_(replay.config()), state_(replay.state()), frames_begin_(replay.ring().frames_begin()) {
    if (replay.ring().is_held())
        throw std::logic_error("a second snapshot of a replay while the first is read");
    ring_.reset(&replay.ring());
    ring_->held_frames.from(frames_begin_);
    ring_->held_transitions.from(state_.transitions_begin);
}

void ReplaySnapshot::save(const fs::path& folder, const TakeOver& take_over) {
    save_chunks(folder, transitions_ring(*ring_), state_.transitions_begin, state_.transitions_end,
                ring_->held_transitions, take_over,
                [&](const auto& visit) { ring_->for_each_transition_array(visit); });
    ring_->held_transitions.release();
    save_chunks(folder, frames_ring(*ring_), frames_begin_, state_.frames_end, ring_->held_frames, take_over,
                [&](const auto& visit) { ring_->for_each_frame_array(visit); });
    ring_.reset();

    ReplayFileWriter file((folder / kStateFile).string(), kStateMagic, kVersion);
    const Saving saving{file};
    for (const ReplayConfigEntry& entry : entries(config_)) saving(&entry.value, 1);
    exchange_state(state_, config_, saving);
    file.commit();
}

void save_replay(Replay& replay, const fs::path& folder) {
    ReplaySnapshot(replay).save(folder);
}

void load_replay(Replay& replay, const fs::path& folder) {
    if (replay.ring().is_held()) throw std::logic_error("a replay is loaded while a snapshot of it is read");
    const auto& config = replay.config();
    auto loaded = std::make_unique<FrameRing>(config);
    FrameRing& ring = *loaded;
    ReplayFileReader file((folder / kStateFile).string(), kStateMagic, kVersion);
    require_same_configuration(config, file);
    ReplayState state;
    exchange_state(state, config, Loading{file});
    file.finish();
    if (!counters_are_possible(state, config)) file.fail("its counters contradict each other");
    if (!windows_are_possible(state)) file.fail("a window shows a frame that it lacks");
    if (config.prioritised && !priorities_are_possible(state))
        file.fail("its priorities contradict each other");

    ring.frames_end = state.frames_end;
    ring.transitions_begin = state.transitions_begin;
    ring.transitions_end = state.transitions_end;
    const auto load_chunks = [&](const Ring& of, std::int64_t begin, std::int64_t end,
                                 const auto& for_each_array) {
        for_each_chunk(begin, end, of.chunk_size(), [&](const Chunk& chunk) {
            load_chunk(folder / file_name(of, chunk), of, chunk, for_each_array);
        });
    };
    load_chunks(transitions_ring(ring), state.transitions_begin, state.transitions_end,
                [&](const auto& visit) { ring.for_each_transition_array(visit); });
    load_chunks(frames_ring(ring), ring.frames_begin(), state.frames_end,
                [&](const auto& visit) { ring.for_each_frame_array(visit); });
    if (!ring.restore_users()) file.fail("a transition shows a frame that it lacks");
    replay.restore(std::move(loaded), std::move(state));
}

}  // namespace cale
