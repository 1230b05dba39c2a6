#include "python/batch.h"

#include <algorithm>
#include <array>
#include <sstream>
#include <stdexcept>
#include <utility>
#include <variant>

#include "python/settings.h"

namespace cale::python {
namespace {

constexpr std::string_view kMagic = "cale environment 1\n";

// ---- saved environments: a sequence of texts, each with its length before it ---------------

void append(std::string& bytes, std::string_view text) {
    const auto size = static_cast<std::uint64_t>(text.size());
    for (int shift = 0; shift < 64; shift += 8) bytes += static_cast<char>(size >> shift & 0xff);
    bytes += text;
}

/// Takes the next text off the front.
std::string_view next(std::string_view& bytes) {
    std::uint64_t size = 0;
    const auto digits = std::min<std::size_t>(bytes.size(), 8);
    for (std::size_t i = 0; i < digits; ++i)
        size |= std::uint64_t{static_cast<unsigned char>(bytes[i])} << 8 * i;
    if (digits < 8 || size > bytes.size() - 8)
        throw std::invalid_argument("the saved state is cut off or damaged");
    const auto text = bytes.substr(8, size);
    bytes.remove_prefix(8 + size);
    return text;
}

std::string_view text_of(std::span<const std::uint8_t> bytes) {
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
std::span<const std::uint8_t> bytes_of(std::string_view text) {
    return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

/// The first line of `theirs` that is not in `ours`, which has the same settings: "threshold=0.5, not 0.4".
std::string difference(std::string_view ours, std::string_view theirs) {
    std::istringstream our_lines{std::string(ours)}, their_lines{std::string(theirs)};
    for (std::string our, their; std::getline(our_lines, our) && std::getline(their_lines, their);)
        if (our != their) return their + ", not " + our.substr(our.find('=') + 1);
    return "other settings";
}

std::string number_text(float number) {
    std::ostringstream text;
    text.precision(9);  // no other float reads the same
    text << number;
    return text.str();
}

}  // namespace

// ---- Background --------------------------------------------------------------------------

Background::Background() : thread_([this] { serve(); }) {}

Background::~Background() {
    {
        const std::lock_guard lock(mutex_);
        ends_ = true;
    }
    changed_.notify_all();
    thread_.join();
}

void Background::start(std::function<void()> task) {
    {
        const std::lock_guard lock(mutex_);
        task_ = std::move(task);
        busy_ = true;
    }
    changed_.notify_all();
}

void Background::wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return !busy_; });
    if (failure_ != nullptr) std::rethrow_exception(std::exchange(failure_, nullptr));
}

void Background::serve() {
    std::unique_lock lock(mutex_);
    while (true) {
        changed_.wait(lock, [this] { return busy_ || ends_; });
        if (ends_) return;
        lock.unlock();
        try {
            task_();
        } catch (...) {
            failure_ = std::current_exception();
        }
        lock.lock();
        busy_ = false;
        changed_.notify_all();
    }
}

// ---- Batch -------------------------------------------------------------------------------

Batch::Batch(const EnvConfig& config, Autoreset autoreset)
    : config_(config),
      autoreset_(autoreset),
      actions_(cale::action_space(config)),
      seen_(cale::observation_space(config)),
      frame_size_(static_cast<std::size_t>(seen_.frame_size())),
      stack_size_(frame_size_ * static_cast<std::size_t>(seen_.stack)),
      stacks_(static_cast<std::size_t>(config.num_envs), static_cast<std::size_t>(seen_.stack), frame_size_),
      frames_(static_cast<std::size_t>(config.num_envs) * frame_size_),
      newest_(static_cast<std::size_t>(config.num_envs)),
      states_(static_cast<std::size_t>(config.num_envs)) {
    static_cast<void>(find_roms(config));
    const Env first(config_of(config, 0), /*seed=*/0);
    events_.assign(first.actions().begin(), first.actions().end());
    if (!events_.empty()) actions_ = Discrete{std::ssize(events_)};
    if (autoreset == Autoreset::same_step) final_stacks_.resize(stacks_.data().size());
}

bool Batch::has_stick() const {
    return moves(config_.motion);
}
bool Batch::has_paddle() const {
    return config_.paddle == Paddle::absolute;
}

VectorEnv& Batch::envs() const {
    if (envs_ == nullptr) throw std::logic_error("no episode was started: call reset() first");
    return *envs_;
}

const Env& Batch::env(std::int64_t index) const {
    return envs().env(index);
}

void Batch::make(std::span<const std::uint32_t> seeds) {
    envs_ = std::make_unique<VectorEnv>(config_, seeds);
    std::ranges::fill(states_, State{});
}

void Batch::begin_episode(std::size_t i, bool new_game) {
    auto& state = states_[i];
    // A lost life ends the agent's episode and not the game, which goes on from what is seen now.
    const bool continues = state.ended && !state.must_restart && !new_game;
    if (!continues) envs_->reset(static_cast<std::int64_t>(i), frame(i));
    stacks_.clear(i);
    stacks_.push(i, frame(i));
    state = {.ended = false, .must_restart = false};
}

void Batch::reset(std::span<const std::optional<std::uint32_t>> seeds, std::span<const bool> mask,
                  bool new_game, const StepArrays& arrays) {
    const bool first = envs_ == nullptr;
    if (first) {
        std::vector<std::uint32_t> all;
        for (const auto& seed : seeds) all.push_back(seed.value());
        make(all);
    }
    envs_->for_each([&](std::int64_t index) {
        const auto i = static_cast<std::size_t>(index);
        if (mask[i]) {
            if (seeds[i] && !first) {
                envs_->renew(index, *seeds[i]);
                states_[i] = {};
            }
            begin_episode(i, new_game);
        }
        write_observation(i, arrays.observations);
        write_infos(i, at_start(i), arrays);
    });
}

/// Whether the next step begins an episode in it, in which its action counts for nothing.
bool Batch::begins(std::size_t i) const {
    return autoreset_ == Autoreset::next_step && (states_[i].ended || states_[i].must_restart);
}

void Batch::check(const Actions& actions) const {
    envs().check(actions);
    const auto refuse = [](std::size_t i, const std::string& what) {
        throw std::invalid_argument("the action of environment " + std::to_string(i) + " is bad: " + what);
    };
    if (const auto* const numbers = std::get_if<std::span<const std::int64_t>>(&actions)) {
        const auto n = num_actions(actions_);
        const bool factored = !std::get<Discrete>(actions_).factors.empty();
        for (std::size_t i = 0; i < numbers->size(); ++i) {
            const auto number = (*numbers)[i];
            if ((number >= 0 && number < n) || begins(i)) continue;
            refuse(i, factored ? "its choices must be 0 to 2, 0 to 2 and 0 to 1"
                               : "there is no action " + std::to_string(number) + ", they are 0 to " +
                                     std::to_string(n - 1));
        }
    } else {
        const auto& box = std::get<Box>(actions_);
        const auto coordinates = std::get<std::span<const float>>(actions);
        const auto axes = box.low.size();
        for (std::size_t k = 0; k < coordinates.size(); ++k) {
            const auto axis = k % axes;
            const bool inside = coordinates[k] >= box.low[axis] && coordinates[k] <= box.high[axis];
            if (inside || begins(k / axes)) continue;
            refuse(k / axes, (box.names.empty() ? "axis " + std::to_string(axis) : box.names[axis]) + " is " +
                                 number_text(coordinates[k]) + ", it must lie in [" +
                                 number_text(box.low[axis]) + ", " + number_text(box.high[axis]) + "]");
        }
    }
    if (autoreset_ == Autoreset::next_step) return;
    const auto ended =
        std::ranges::find_if(states_, [](const State& state) { return state.ended || state.must_restart; });
    if (ended == states_.end()) return;
    throw std::logic_error("the episode of environment " + std::to_string(ended - states_.begin()) +
                           " is over: reset it first");
}

void Batch::step(const Actions& actions, const StepArrays& arrays) {
    check(actions);
    envs_->for_each([&](std::int64_t index) { step_one(static_cast<std::size_t>(index), actions, arrays); });
}

void Batch::step_one(std::size_t i, const Actions& actions, const StepArrays& arrays) {
    auto& state = states_[i];
    auto& newest = newest_[i];
    if (state.ended || state.must_restart) {
        begin_episode(i, false);
        newest = at_start(i);
    } else {
        newest = shown(i, envs_->step(static_cast<std::int64_t>(i), actions, frame(i)));
        stacks_.push(i, frame(i));
        state = {.ended = newest.result.terminal || newest.result.truncated,
                 .must_restart = newest.result.episode_over};
    }
    arrays.rewards[i] = newest.result.reward;
    arrays.terminated[i] = newest.result.terminal;
    arrays.truncated[i] = newest.result.truncated;
    const bool restarts = state.ended && autoreset_ == Autoreset::same_step;
    if (restarts) {
        write_observation(i, final_stacks_);
        begin_episode(i, false);
    }
    write_observation(i, arrays.observations);
    write_infos(i, restarts ? at_start(i) : newest, arrays);
}

void Batch::begin_step(const Actions& actions, const StepArrays& arrays) {
    check(actions);
    Actions copied;
    if (const auto* const numbers = std::get_if<std::span<const std::int64_t>>(&actions)) {
        sent_numbers_.assign(numbers->begin(), numbers->end());
        copied = std::span<const std::int64_t>(sent_numbers_);
    } else {
        const auto coordinates = std::get<std::span<const float>>(actions);
        sent_coordinates_.assign(coordinates.begin(), coordinates.end());
        copied = std::span<const float>(sent_coordinates_);
    }
    if (background_ == nullptr) background_ = std::make_unique<Background>();
    background_->start([this, copied, arrays] {
        envs_->for_each(
            [&](std::int64_t index) { step_one(static_cast<std::size_t>(index), copied, arrays); });
    });
}

void Batch::end_step() {
    background_->wait();
}

void Batch::write_observation(std::size_t i, std::span<std::uint8_t> observations) const {
    if (observations.empty()) return;
    const auto stack = stacks_.data().subspan(i * stack_size_, stack_size_);
    std::ranges::copy(stack, observations.subspan(i * stack_size_, stack_size_).begin());
}

Batch::Shown Batch::shown(std::size_t i, const StepResult& result) const {
    const Env& env = envs_->env(static_cast<std::int64_t>(i));
    return {result, env.stick().value_or(StickPosition{}), env.paddle().value_or(0)};
}
Batch::Shown Batch::at_start(std::size_t i) const {
    return shown(i, {.frames = 0, .lives = envs_->env(static_cast<std::int64_t>(i)).lives()});
}

void Batch::write_infos(std::size_t i, const Shown& shown, const StepArrays& arrays) const {
    const auto& [result, stick, paddle] = shown;
    arrays.episode_over[i] = result.episode_over;
    arrays.lives[i] = result.lives;
    arrays.frames[i] = result.frames;
    arrays.event[i] = result.event;
    const auto skip = static_cast<std::size_t>(config_.frame_skip);
    std::copy_n(result.frame_events.begin(), skip, arrays.frame_events.subspan(i * skip, skip).begin());
    const std::array position{stick.x, stick.y, stick.button};
    if (!arrays.stick.empty())
        std::ranges::copy(position, arrays.stick.subspan(i * position.size(), position.size()).begin());
    if (!arrays.paddle.empty()) arrays.paddle[i] = paddle;
}

void Batch::write_final(std::int64_t index, std::span<std::uint8_t> observation,
                        const StepArrays& arrays) const {
    const auto i = static_cast<std::size_t>(index);
    std::ranges::copy(std::span(final_stacks_).subspan(i * stack_size_, stack_size_), observation.begin());
    write_infos(i, newest_[i], arrays);
}

void Batch::write_current(const StepArrays& arrays) const {
    for (std::size_t i = 0; i < states_.size(); ++i) {
        write_observation(i, arrays.observations);
        auto shown = at_start(i);
        shown.result.episode_over = states_[i].must_restart;
        write_infos(i, shown, arrays);
    }
}

void Batch::close() {
    closed_ = true;
    background_.reset();
    envs_.reset();
}

std::string Batch::save(std::int64_t index) const {
    const auto record = envs().record(index);
    const auto i = static_cast<std::size_t>(index);
    std::string saved(kMagic);
    append(saved, course_of_games(config_of(config_, index)));
    append(saved, {states_[i].ended ? "1" : "0"});
    append(saved, {states_[i].must_restart ? "1" : "0"});
    append(saved, text_of(stacks_.data().subspan(i * stack_size_, stack_size_)));
    for (const auto& [name, bytes] : record) {
        append(saved, name);
        append(saved, text_of(bytes));
    }
    return saved;
}

struct Batch::Saved {
    State state;
    std::span<const std::uint8_t> stack;
    EpisodeRecord record{};
};

Batch::Saved Batch::parsed(std::int64_t index, std::string_view saved) const {
    if (!saved.starts_with(kMagic))
        throw std::invalid_argument("these bytes are no environment that save() returned");
    saved.remove_prefix(kMagic.size());
    const auto ours = course_of_games(config_of(config_, index));
    if (const auto theirs = next(saved); theirs != ours)
        throw std::invalid_argument("the saved environment has " + difference(ours, theirs));
    Saved parts{.state = {.ended = next(saved) == "1", .must_restart = next(saved) == "1"},
                .stack = bytes_of(next(saved))};
    if (parts.stack.size() != stack_size_)
        throw std::invalid_argument("the saved state is cut off or damaged");
    while (!saved.empty()) {
        const std::string name(next(saved));
        const auto bytes = bytes_of(next(saved));
        parts.record[name].assign(bytes.begin(), bytes.end());
    }
    return parts;
}

void Batch::restore(const std::map<std::int64_t, std::string_view>& saved) {
    std::map<std::int64_t, Saved> all;
    for (const auto& [index, bytes] : saved) all.emplace(index, parsed(index, bytes));
    if (envs_ == nullptr) make(std::vector<std::uint32_t>(states_.size()));
    envs_->for_each([&](std::int64_t index) {
        const auto found = all.find(index);
        if (found == all.end()) return;
        const auto& [state, stack, record] = found->second;
        const auto i = static_cast<std::size_t>(index);
        states_[i] = {};  // to be reset, should this fail
        envs_->resume(index, record);
        stacks_.clear(i);
        for (std::size_t offset = 0; offset < stack.size(); offset += frame_size_)
            stacks_.push(i, stack.subspan(offset, frame_size_));
        std::ranges::copy(stack.last(frame_size_), frame(i).begin());
        states_[i] = state;
    });
}

}  // namespace cale::python
