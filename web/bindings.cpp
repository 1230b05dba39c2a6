// The session as JavaScript sees it. Arrays are views of the module's memory, valid until the next call.
#include <emscripten/bind.h>

#include <exception>
#include <string>

#include "web/session.h"
#include "web/settings.h"

namespace {

using cale::web::Moment;
using cale::web::Session;
using emscripten::val;

/// Calls `body`. What it throws becomes a JavaScript Error.
template <class Body>
auto guarded(const Body& body) {
    std::string sentence;
    try {
        return body();
    } catch (const std::exception& error) {
        sentence = error.what();
    }
    val::global("Error").new_(sentence).throw_();
}

template <class Number>
val view(std::span<Number> numbers) {
    return val(emscripten::typed_memory_view(numbers.size(), numbers.data()));
}

val object(const cale::ContinuousAction& action) {
    val result = val::object();
    result.set("radius", action.radius);
    result.set("theta", action.theta);
    result.set("fire", action.fire);
    return result;
}

val object(const Moment& moment) {
    const auto& step = moment.result;
    val result = val::object();
    result.set("byHand", moment.by_hand);
    result.set("commanded", object(moment.commanded));
    val decision = object(moment.decision.stick);
    decision.set("action", static_cast<double>(moment.decision.action));
    result.set("decision", decision);
    result.set("reward", step.reward);
    result.set("lives", step.lives);
    result.set("over", step.episode_over);
    result.set("event", static_cast<int>(step.event));
    val seen = val::array();
    for (int i = 0; i < step.frames; ++i) seen.set(i, static_cast<int>(step.frame_events.at(std::size_t(i))));
    result.set("seen", seen);
    result.set("episodeReturn", moment.episode_return);
    result.set("steps", static_cast<double>(moment.steps));
    return result;
}

/// How the numbers of its output are to be read.
std::string head(const Session& session) {
    if (session.info().actions.empty()) return "gaussian";
    return session.gives_action_values() ? "values" : "log-probabilities";
}

void load_policy(Session& session, const std::string& contents, const std::string& name) {
    guarded([&] { session.load_policy(contents, name); });
}
void insert_rom(Session& session, const std::string& bytes) {
    guarded([&] { session.insert_rom(bytes); });
}
void start(Session& session, const std::string& changes, double seed) {
    guarded([&] { session.start(changes, static_cast<std::uint64_t>(seed)); });
}
val step(Session& session) {
    return guarded([&] { return object(session.step()); });
}
val step_by_hand(Session& session, float radius, float theta, float fire) {
    return guarded([&] { return object(session.step(cale::ContinuousAction{radius, theta, fire})); });
}

val info(const Session& session) {
    return guarded([&] {
        const auto& policy = session.info();
        val result = val::object();
        result.set("game", policy.game);
        result.set("agent", policy.agent);
        result.set("encoder", policy.encoder);
        result.set("head", head(session));
        result.set("stack", static_cast<double>(policy.stack));
        result.set("rows", static_cast<double>(policy.frame_height));
        result.set("columns", static_cast<double>(policy.frame_width));
        const auto steps = policy.provenance.find("agent_steps");
        result.set("agentSteps", steps == policy.provenance.end() ? std::string() : steps->second);
        return result;
    });
}

std::string trained(const Session& session, const std::string& name) {
    return guarded([&] { return cale::web::setting(session.trained(), name); });
}

int frame_count(const Session& session) {
    return static_cast<int>(session.frames().size());
}
val screen(const Session& session, int frame) {
    return guarded([&] { return view(std::span(session.frame(frame).rgba)); });
}
val stick(const Session& session, int frame) {
    return guarded([&] {
        const auto& position = session.frame(frame).stick;
        if (!position) return val::null();
        val result = val::object();
        result.set("x", position->x);
        result.set("y", position->y);
        result.set("button", position->button);
        return result;
    });
}
val observation(const Session& session) {
    return guarded([&] { return view(session.observation()); });
}
val output(const Session& session) {
    return guarded([&] { return view(session.output()); });
}
val draws(Session& session) {
    return guarded([&] { return view(session.draws()); });
}
val event_values(Session& session) {
    return guarded([&] { return view(session.event_values()); });
}

}  // namespace

EMSCRIPTEN_BINDINGS(cale) {
    emscripten::class_<Session>("Session")
        .constructor()
        .property("hasGame", &Session::has_game)
        .property("hasRom", &Session::has_rom)
        .property("screenHeight", &Session::screen_height)
        .property("screenWidth", &Session::screen_width)
        .function("loadPolicy", &load_policy)
        .function("insertRom", &insert_rom)
        .function("start", &start)
        .function("step", &step)
        .function("stepByHand", &step_by_hand)
        .function("info", &info)
        .function("trained", &trained)
        .function("frameCount", &frame_count)
        .function("screen", &screen)
        .function("stick", &stick)
        .function("observation", &observation)
        .function("output", &output)
        .function("draws", &draws)
        .function("eventValues", &event_values);
}
