// The module cale._core: what cale's Python classes are made of. The GIL is released while environments step,
// games are played and policies act.
#include <pthread.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "cale/fields.h"
#include "cale/games.h"
#include "cale/setting.h"
#include "policy/policy_lite.h"
#include "python/batch.h"
#include "python/evaluated_game.h"
#include "python/settings.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace cale::python {
namespace {

template <class Number>
using Array = nb::ndarray<Number, nb::numpy, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<nb::numpy, std::uint8_t>;

template <class Number>
std::span<Number> span_of(const Array<Number>& array) {
    return {array.data(), array.size()};
}
template <class Number>
std::span<Number> span_of(const std::optional<Array<Number>>& array) {
    return array ? span_of(*array) : std::span<Number>();
}

// Threads that work without the GIL. One that wanted it back after the interpreter's end would be ended by
// Python, in the midst of C++ code, and the process with it. So that end waits for them, and lets no other
// begin. Both are read and written by whoever has the GIL.
std::int64_t threads_without_gil = 0;
bool interpreter_ends = false;

/// Calls work() without the GIL.
template <class Work>
auto without_gil(const Work& work) {
    struct Counted {
        Counted() { ++threads_without_gil; }
        ~Counted() { --threads_without_gil; }
    };
    const Counted counted;
    const nb::gil_scoped_release released;
    return work();
}

/// The same, unless the interpreter is ending.
template <class Work>
auto run_without_gil(const Work& work) {
    if (interpreter_ends) throw std::runtime_error("the interpreter is ending");
    return without_gil(work);
}

void end() {
    interpreter_ends = true;
    while (threads_without_gil > 0) {
        const nb::gil_scoped_release released;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}

/// Returns a new array with these bytes, for NumPy.
Bytes new_array(std::vector<std::uint8_t> bytes, std::vector<std::size_t> shape) {
    auto kept = std::make_unique<std::vector<std::uint8_t>>(std::move(bytes));
    auto* const data = kept->data();
    const nb::capsule owner(kept.release(), [](void* vector) noexcept {
        delete static_cast<std::vector<std::uint8_t>*>(vector);
    });
    return Bytes(data, shape.size(), shape.data(), owner);
}

// ---- settings ------------------------------------------------------------------------------

/// A value as Python has it.
struct ToPython {
    template <class Number>
    nb::object operator()(const std::optional<Number>* value) const {
        return *value ? nb::cast(**value) : nb::none();
    }
    nb::object operator()(const IntegerRange* value) const {
        return value->low == value->high ? nb::cast(value->low)
                                         : nb::cast(std::pair(value->low, value->high));
    }
    nb::object operator()(const EnumMember& value) const {
        return nb::cast(std::string(value.names[value.get()]));
    }
    template <class Value>
    nb::object operator()(const Value* value) const {
        return nb::cast(*value);
    }
};

nb::list settings() {
    EnvConfig config;
    nb::list result;
    for (const auto& setting : setting_fields(config)) {
        nb::list choices;
        if (const auto* const member = std::get_if<EnumMember>(&setting.member))
            for (const auto name : member->names) choices.append(std::string(name));
        nb::dict entry;
        entry["name"] = setting.name;
        entry["default"] = std::visit(ToPython{}, setting.member);
        entry["type"] = setting_type(setting.member);
        entry["range"] = range_text(setting.range);
        entry["choices"] = nb::tuple(choices);
        entry["help"] = setting.help;
        result.append(entry);
    }
    return result;
}

EnvConfig read_config(const nb::dict& texts) {
    EnvConfig config;
    for (const auto& [name, text] : texts) {
        try {
            set(config, nb::cast<std::string>(name), nb::cast<std::string>(text));
        } catch (const std::out_of_range& error) {
            throw nb::type_error(error.what());
        }
    }
    games_of(config.game);  // throws for unknown ones
    return config;
}

nb::list game_table() {
    nb::list table;
    for (const auto& game : all_games()) {
        nb::dict row;
        row["name"] = std::string(game.name);
        row["rom"] = std::string(game.rom);
        row["in_atari100k"] = game.in_atari100k;
        row["random_score"] = game.random_score;
        row["human_score"] = game.human_score;
        table.append(row);
    }
    return table;
}

// ---- environments --------------------------------------------------------------------------

/// NumPy's arrays for what a step brings, held as long as environments may write to them.
struct Arrays {
    std::optional<Array<std::uint8_t>> observations;
    Array<double> rewards;
    Array<bool> terminated, truncated, episode_over;
    Array<std::int32_t> lives, frames;
    Array<std::uint8_t> event, frame_events;
    std::optional<Array<double>> stick, paddle;

    /// Throws std::invalid_argument where an array does not have room for the environments of `batch`.
    StepArrays of(const Batch& batch) const {
        const auto n = static_cast<std::size_t>(batch.size());
        const auto skip = static_cast<std::size_t>(batch.config().frame_skip);
        const bool fit = (!observations || observations->size() == batch.stacks().size()) &&
                         rewards.size() == n && terminated.size() == n && truncated.size() == n &&
                         episode_over.size() == n && lives.size() == n && frames.size() == n &&
                         event.size() == n && frame_events.size() == n * skip &&
                         (!stick || stick->size() == 3 * n) && (!paddle || paddle->size() == n);
        if (!fit) throw std::invalid_argument("the arrays do not have the size that the environments need");
        return {.observations = span_of(observations),
                .rewards = span_of(rewards),
                .terminated = span_of(terminated),
                .truncated = span_of(truncated),
                .episode_over = span_of(episode_over),
                .lives = span_of(lives),
                .frames = span_of(frames),
                .event = span_of(event),
                .frame_events = span_of(frame_events),
                .stick = span_of(stick),
                .paddle = span_of(paddle)};
    }
};

/// The environments that a Python object holds. Threads may share it: they take turns.
class Envs {
  public:
    Envs(const nb::dict& texts, Autoreset autoreset) {
        const auto config = read_config(texts);
        batch_ = run_without_gil([&] { return std::make_unique<Batch>(config, autoreset); });
    }
    ~Envs() {
        // The threads of a parent process are not there to be joined in its child.
        if (process_ != getpid()) static_cast<void>(batch_.release());
    }
    Envs(const Envs&) = delete;
    Envs& operator=(const Envs&) = delete;

    /// Calls work(batch) without the GIL, when no other thread is at it.
    template <class Work>
    auto run(const Work& work) {
        if (process_ != getpid()) {
            throw std::runtime_error(
                "these environments were made before this process was forked, and their threads are not in "
                "it: make them in the process that uses them, or start it by spawn or forkserver");
        }
        return run_without_gil([&] {
            const std::lock_guard lock(mutex_);
            if (batch_->is_closed()) throw std::runtime_error("these environments are closed");
            return work(*batch_);
        });
    }
    /// The same of environments that are not stepping in the background.
    template <class Work>
    auto run_idle(const Work& work) {
        return run([&](Batch& batch) {
            if (sent_.is_valid()) throw std::logic_error("a step is under way: call recv() first");
            return work(batch);
        });
    }

    /// `kept` holds the arrays as long as they are written to.
    void send(const Actions& actions, const Arrays& arrays, nb::object kept) {
        run_idle([&](Batch& batch) {
            batch.begin_step(actions, arrays.of(batch));
            sent_ = std::move(kept);  // of an object into none: without the GIL
        });
    }
    nb::object recv() {
        nb::object kept;
        run([&](Batch& batch) {
            if (!sent_.is_valid()) throw std::logic_error("nothing was sent: call send() first");
            kept = std::move(sent_);
            batch.end_step();
        });
        return kept;
    }
    void close() {
        if (process_ != getpid()) return;
        nb::object dropped;  // with the GIL; arrays of a step that nobody received may hold this object
        without_gil([&] {
            const std::lock_guard lock(mutex_);
            batch_->close();
            dropped = std::move(sent_);
        });
    }

  private:
    pid_t process_ = getpid();
    std::mutex mutex_;
    nb::object sent_;               // what recv() returns; none where no step is under way
    std::unique_ptr<Batch> batch_;  // the last member: its threads use the others
};

template <class Number>
void step(Envs& envs, const Array<const Number>& actions, const Arrays& arrays) {
    envs.run_idle([&](Batch& batch) { batch.step(span_of(actions), arrays.of(batch)); });
}

template <class Number>
void send(Envs& envs, const Array<const Number>& actions, const Arrays& arrays, nb::object kept) {
    envs.send(span_of(actions), arrays, std::move(kept));
}

nb::tuple action_space(Envs& envs) {
    const auto space = envs.run([](Batch& batch) { return batch.action_space(); });
    if (const auto* const discrete = std::get_if<Discrete>(&space))
        return nb::make_tuple("discrete", discrete->n, discrete->factors);
    const auto& box = std::get<Box>(space);
    return nb::make_tuple("box", box.low, box.high, box.names);
}

std::vector<std::int64_t> observation_shape(Envs& envs) {
    return envs.run([](Batch& batch) { return batch.observation_space().tensor_shape(); });
}

Bytes stacks(nb::handle_t<Envs> self) {
    auto& envs = nb::cast<Envs&>(self);
    const auto shape = observation_shape(envs);
    std::vector<std::size_t> extents{0};
    extents.insert(extents.end(), shape.begin(), shape.end());
    auto* const data = envs.run([&](Batch& batch) {
        extents.front() = static_cast<std::size_t>(batch.size());
        return const_cast<std::uint8_t*>(batch.stacks().data());
    });
    return Bytes(data, extents.size(), extents.data(), self);
}

void bind_environments(nb::module_& m) {
    nb::class_<Arrays>(m, "Arrays", "NumPy arrays for what a step brings.")
        .def(
            "__init__",
            [](Arrays* self, std::optional<Array<std::uint8_t>> observations, Array<double> rewards,
               Array<bool> terminated, Array<bool> truncated, Array<bool> episode_over,
               Array<std::int32_t> lives, Array<std::int32_t> frames, Array<std::uint8_t> event,
               Array<std::uint8_t> frame_events, std::optional<Array<double>> stick,
               std::optional<Array<double>> paddle) {
                new (self) Arrays{std::move(observations), std::move(rewards),      std::move(terminated),
                                  std::move(truncated),    std::move(episode_over), std::move(lives),
                                  std::move(frames),       std::move(event),        std::move(frame_events),
                                  std::move(stick),        std::move(paddle)};
            },
            "observations"_a.none(), "rewards"_a, "terminated"_a, "truncated"_a, "episode_over"_a, "lives"_a,
            "frames"_a, "event"_a, "frame_events"_a, "stick"_a.none(), "paddle"_a.none());

    nb::enum_<Autoreset>(m, "Autoreset", "When the next episode begins.")
        .value("NEXT_STEP", Autoreset::next_step)
        .value("SAME_STEP", Autoreset::same_step)
        .value("DISABLED", Autoreset::disabled);

    nb::class_<Envs>(m, "Envs", "N environments that step together.")
        .def(nb::init<const nb::dict&, Autoreset>(), "settings"_a, "autoreset"_a)
        .def_prop_ro("action_space", action_space,
                     "('discrete', n, factors) or ('box', low, high, names), of one environment.")
        .def_prop_ro("observation_shape", observation_shape, "The shape of one environment's observation.")
        .def_prop_ro(
            "num_envs", [](Envs& envs) { return envs.run([](Batch& batch) { return batch.size(); }); },
            "How many there are.")
        .def_prop_ro(
            "games",
            [](Envs& envs) {
                return envs.run([](Batch& batch) {
                    std::vector<std::string> names;
                    for (std::int64_t i = 0; i < batch.size(); ++i)
                        names.push_back(config_of(batch.config(), i).game);
                    return names;
                });
            },
            "What each of them plays.")
        .def_prop_ro(
            "frame_skip",
            [](Envs& envs) { return envs.run([](Batch& batch) { return batch.config().frame_skip; }); },
            "Emulated frames per agent step.")
        .def_prop_ro(
            "has_stick", [](Envs& envs) { return envs.run([](Batch& batch) { return batch.has_stick(); }); },
            "Whether the joystick moves, so that it has a position.")
        .def_prop_ro(
            "has_paddle",
            [](Envs& envs) { return envs.run([](Batch& batch) { return batch.has_paddle(); }); },
            "Whether actions place the paddle.")
        .def_prop_ro("stacks", stacks, "The newest observations: a view that the next step overwrites.")
        .def(
            "reset",
            [](Envs& envs, const std::vector<std::optional<std::uint32_t>>& seeds,
               const Array<const bool>& mask, bool new_game, const Arrays& arrays) {
                envs.run_idle([&](Batch& batch) {
                    const auto n = static_cast<std::size_t>(batch.size());
                    if (seeds.size() != n || mask.size() != n)
                        throw std::invalid_argument("a reset needs a seed and a mask for each environment");
                    batch.reset(seeds, span_of(mask), new_game, arrays.of(batch));
                });
            },
            "seeds"_a, "mask"_a, "new_game"_a, "arrays"_a, "Begins episodes where the mask is true.")
        .def("step", step<float>, "actions"_a.noconvert(), "arrays"_a, "One agent step of all environments.")
        .def("step", step<std::int64_t>, "actions"_a.noconvert(), "arrays"_a)
        .def("send", send<float>, "actions"_a.noconvert(), "arrays"_a, "kept"_a,
             "Begins a step in the background. `kept` must hold the arrays.")
        .def("send", send<std::int64_t>, "actions"_a.noconvert(), "arrays"_a, "kept"_a)
        .def("recv", &Envs::recv,
             "Waits until the arrays are written, and returns what send() was given to keep.")
        .def(
            "final",
            [](Envs& envs, std::int64_t index, const Array<std::uint8_t>& observation, const Arrays& arrays) {
                envs.run_idle(
                    [&](Batch& batch) { batch.write_final(index, span_of(observation), arrays.of(batch)); });
            },
            "index"_a, "observation"_a, "arrays"_a,
            "Writes what the newest step showed of an episode that ended in it.")
        .def(
            "current",
            [](Envs& envs, const Arrays& arrays) {
                envs.run_idle([&](Batch& batch) { batch.write_current(arrays.of(batch)); });
            },
            "arrays"_a, "Writes what all environments show now.")
        .def(
            "save",
            [](Envs& envs, std::int64_t index) {
                const auto saved = envs.run_idle([&](Batch& batch) { return batch.save(index); });
                return nb::bytes(saved.data(), saved.size());
            },
            "index"_a, "All that the future of an environment depends on.")
        .def(
            "restore",
            [](Envs& envs, std::int64_t index, const nb::bytes& saved) {
                const std::string_view bytes(saved.c_str(), saved.size());  // while Python's lock is held
                envs.run_idle([&](Batch& batch) { batch.restore({{index, bytes}}); });
            },
            "index"_a, "saved"_a, "Continues as the environment that was saved.")
        .def(
            "restore",
            [](Envs& envs, const nb::dict& saved) {
                std::map<std::int64_t, std::string_view> states;
                for (const auto& [index, state] : saved) {
                    const auto bytes = nb::cast<nb::bytes>(state);
                    states[nb::cast<std::int64_t>(index)] = {bytes.c_str(), bytes.size()};
                }
                envs.run_idle([&](Batch& batch) { batch.restore(states); });
            },
            "saved"_a, "Continues as the environments that were saved, by index.")
        .def(
            "screen",
            [](Envs& envs, std::int64_t index) {
                std::vector<std::uint8_t> pixels;
                const auto height = envs.run_idle([&](Batch& batch) {
                    const Env& env = batch.env(index);
                    env.screen_rgb(pixels);
                    return static_cast<std::size_t>(env.screen_height());
                });
                const auto width = pixels.size() / 3 / height;
                return new_array(std::move(pixels), {height, width, 3});
            },
            "index"_a, "The game's screen in colour.")
        .def(
            "ram",
            [](Envs& envs, std::int64_t index) {
                auto bytes = envs.run_idle([&](Batch& batch) {
                    const auto ram = batch.env(index).ram();
                    return std::vector<std::uint8_t>(ram.begin(), ram.end());
                });
                return new_array(std::move(bytes), {kRamSize});
            },
            "index"_a, "The console's 128 bytes of memory.")
        .def(
            "frame_number",
            [](Envs& envs, std::int64_t index) {
                return envs.run_idle([&](Batch& batch) { return batch.env(index).frame_number(); });
            },
            "index"_a, "Frames emulated since the ROM was loaded.")
        .def(
            "events",
            [](Envs& envs) {
                std::vector<std::string> names;
                for (const auto event : envs.run_idle([](Batch& batch) { return batch.events(); }))
                    names.emplace_back(event_name(event));
                return names;
            },
            "The joystick events of discrete actions.")
        .def("close", &Envs::close, "Waits for a step that is under way, and ends the environments.");
}

// ---- policies ------------------------------------------------------------------------------

constexpr std::size_t kRows = 8;  // observations that share a pass over the weights

/// A policy and what it draws from. Threads may share it: they take turns.
class PolicyInUse {
  public:
    explicit PolicyInUse(lite::Policy loaded)
        : policy(std::move(loaded)), workspace(policy.workspace(kRows)) {}

    /// Calls work() without the GIL, while no other thread uses the policy.
    template <class Work>
    void run(const Work& work) {
        renew_after_fork();
        run_without_gil([&] {
            const std::lock_guard lock(*mutex_);
            work();
        });
    }

    const lite::Policy policy;
    lite::Workspace workspace;
    std::mt19937_64 random{0};

  private:
    /// In a forked process a thread that is not there may hold the mutex, in the midst of its work.
    void renew_after_fork() {
        if (process_ == getpid()) return;
        static_cast<void>(mutex_.release());
        mutex_ = std::make_unique<std::mutex>();
        workspace = policy.workspace(kRows);
        process_ = getpid();
    }

    std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();
    pid_t process_ = getpid();
};

Choice choice_of(const std::string& name) {
    if (name == "greedy") return Choice::greedy;
    if (name == "sampled") return Choice::sampled;
    if (name == "as_evaluated") return Choice::as_evaluated;
    throw std::invalid_argument("choice must be one of greedy, sampled, as_evaluated, not '" + name + "'");
}

void check_observations(const PolicyInUse& self, const Array<const std::uint8_t>& observations,
                        std::size_t count) {
    if (observations.size() == count * self.policy.info().observation_size()) return;
    throw std::invalid_argument("the observations have another shape than the policy's");
}

void act(PolicyInUse& self, const Array<const std::uint8_t>& observations, const std::string& choice,
         const Array<float>& coordinates, const Array<std::int64_t>& actions) {
    const auto count = actions.size();
    const auto joystick = written_coordinates(self.policy.info());
    const auto axes = stick_coordinates(joystick).size();
    check_observations(self, observations, count);
    if (coordinates.size() != axes * count)
        throw std::invalid_argument("the array for the coordinates has another size");
    const auto chosen = choice_of(choice);
    self.run([&] {
        std::vector<Decision> decisions(count);
        self.policy.act(span_of(observations), decisions, self.workspace, chosen, self.random);
        for (std::size_t i = 0; i < count; ++i) {
            std::ranges::copy(coordinates_of(joystick, decisions[i].stick), coordinates.data() + axes * i);
            actions.data()[i] = decisions[i].action;
        }
    });
}

void output(PolicyInUse& self, const Array<const std::uint8_t>& observations, const Array<float>& numbers) {
    const auto size = self.policy.output_size();
    const auto count = numbers.size() / size;
    check_observations(self, observations, count);
    self.run([&] {
        const auto bytes = self.policy.info().observation_size();
        for (std::size_t i = 0; i < count; ++i) {
            const auto row =
                self.policy.output(span_of(observations).subspan(i * bytes, bytes), self.workspace);
            std::ranges::copy(row, numbers.data() + i * size);
        }
    });
}

nb::dict info_of(const PolicyInUse& self) {
    const auto& info = self.policy.info();
    nb::dict result;
    result["game"] = info.game;
    result["agent"] = info.agent;
    result["encoder"] = info.encoder;
    result["action_space"] = info.action_space;
    result["joystick"] = std::string(name_of(info.joystick));
    nb::list actions;
    for (const auto event : info.actions) actions.append(std::string(event_name(event)));
    result["actions"] = actions;
    result["threshold"] = info.threshold;
    result["observation_shape"] = nb::tuple(nb::cast(observation_shape(info)));
    result["frame_skip"] = info.frame_skip;
    result["life_loss_ends_episode"] = info.life_loss_ends_episode;
    result["evaluation_samples"] = info.evaluation_samples;
    result["epsilon"] = info.epsilon;
    nb::dict provenance;
    for (const auto& [name, text] : info.provenance) provenance[name.c_str()] = text;
    result["provenance"] = provenance;
    return result;
}

struct Stop {
    std::atomic<bool> requested = false;
};

void bind_policies(nb::module_& m) {
    nb::class_<PolicyInUse>(m, "Policy", "A trained policy.")
        .def(
            "__init__",
            [](PolicyInUse* self, const std::string& file) {
                new (self) PolicyInUse(run_without_gil([&] { return lite::Policy::load(file); }));
            },
            "file"_a)
        .def_prop_ro("info", info_of, "All but the weights.")
        .def_prop_ro(
            "output_size", [](const PolicyInUse& self) { return self.policy.output_size(); },
            "Numbers that the network gives for an observation.")
        .def_prop_ro(
            "axes",
            [](const PolicyInUse& self) {
                return stick_coordinates(written_coordinates(self.policy.info())).size();
            },
            "Coordinates of the continuous joystick that act() writes.")
        .def_prop_ro(
            "gives_action_values", [](const PolicyInUse& self) { return self.policy.gives_action_values(); },
            "Whether these are action values.")
        .def(
            "seed", [](PolicyInUse& self, std::uint64_t seed) { self.run([&] { self.random.seed(seed); }); },
            "seed"_a, "Seeds what actions are drawn from.")
        .def("act", act, "observations"_a, "choice"_a, "coordinates"_a, "actions"_a,
             "Writes a decision for each observation.")
        .def("output", output, "observations"_a, "numbers"_a, "Writes the network's output.");

    nb::class_<Stop>(m, "Stop", "Ends games under way, of any thread.")
        .def(nb::init<>())
        .def(
            "request", [](Stop& self) { self.requested = true; }, "Ends them at their next step.");
    m.def(
        "play_game",
        [](const PolicyInUse& policy, const nb::dict& texts, double epsilon, bool sampled, std::uint64_t seed,
           std::int64_t number, const Stop& stop) {
            const GamePlan plan{.env = read_config(texts),
                                .epsilon = epsilon,
                                .sampled = sampled,
                                .seed = seed,
                                .stop = &stop.requested};
            const auto game = run_without_gil([&] { return play_game(policy.policy, plan, number); });
            return std::tuple(game.episode_return, game.length, game.frames);
        },
        "policy"_a, "settings"_a, "epsilon"_a, "sampled"_a, "seed"_a, "number"_a, "stop"_a,
        "Plays a game from its beginning to its end: its return, agent steps and frames.");
    m.def(
        "require_playable",
        [](const PolicyInUse& policy, const nb::dict& texts) {
            require_playable(policy.policy.info(), read_config(texts));
        },
        "policy"_a, "settings"_a, "Refuses an environment that the policy cannot act in.");
}

}  // namespace

NB_MODULE(_core, m) {
    m.doc() = "What cale's Python classes are made of.";
    // Objects of threads that are still at work when the interpreter ends are no leak.
    nb::set_leak_warnings(false);
    // The threads that are counted stay behind in the process that forks.
    pthread_atfork(nullptr, nullptr, [] { threads_without_gil = 0; });
    m.def("end", end, "Waits for threads that work without the GIL, and lets no other begin.");
    nb::module_::import_("atexit").attr("register")(m.attr("end"));
    m.def("games", game_table, "The games: names and reference scores.");
    m.def("settings", settings, "The settings of an environment: name, default, type, range, choices, help.");
    m.def(
        "check_settings", [](const nb::dict& texts) { read_config(texts); }, "settings"_a,
        "Refuses settings that are not allowed.");
    bind_environments(m);
    bind_policies(m);
}

}  // namespace cale::python
