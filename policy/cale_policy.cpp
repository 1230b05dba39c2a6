#include "policy/cale_policy.h"

#include <exception>
#include <new>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>

#include "cale/fields.h"
#include "policy/observer.h"
#include "policy/policy_lite.h"

struct cale_policy {
    cale::lite::Policy policy;
};

struct cale_session {
    cale_session(const cale::lite::Policy& shared, int screen_height, std::uint64_t seed)
        : policy(shared), workspace(policy.workspace()), random(seed) {
        if (cale::Observer::observes(policy.info())) observer.emplace(policy.info(), screen_height);
    }

    cale::lite::Policy policy;  // shares the weights
    cale::lite::Workspace workspace;
    std::mt19937_64 random;
    std::optional<cale::Observer> observer;  // none of frames that it does not make
    bool started = false;
};

namespace {

std::string& last_error() {
    thread_local std::string error;
    return error;
}

/// What `action` returns, or `failure` where it throws. Nothing gets past.
template <class Result, class Action>
Result guarded(Result failure, Action&& action) noexcept {
    try {
        return action();
    } catch (const std::bad_alloc&) {
        last_error() = "out of memory";  // short enough to need none
        return failure;
    } catch (const std::exception& error) {
        try {
            last_error() = error.what();
        } catch (...) {
            last_error().clear();  // no memory for a sentence
        }
        return failure;
    }
}

void require(const void* pointer, const char* what) {
    if (pointer == nullptr) throw std::invalid_argument(std::string(what) + " is NULL");
}

cale::Choice choice_of(int choice) {
    switch (choice) {
        case CALE_GREEDY:
            return cale::Choice::greedy;
        case CALE_SAMPLED:
            return cale::Choice::sampled;
        case CALE_AS_EVALUATED:
            return cale::Choice::as_evaluated;
        default:
            throw std::invalid_argument("there is no choice " + std::to_string(choice) +
                                        ": CALE_GREEDY, CALE_SAMPLED and CALE_AS_EVALUATED are 0 to 2");
    }
}

cale::Observer& observer_of(cale_session* session) {
    require(session, "the session");
    if (session->observer) return *session->observer;
    const auto& info = session->policy.info();
    throw std::invalid_argument("this policy reads frames of " + std::to_string(info.frame_height) + "x" +
                                std::to_string(info.frame_width) +
                                ", which are not made of screens: call cale_session_act_on() with "
                                "observations of your own");
}

cale_decision plain(const cale::Decision& decision) {
    return {decision.stick.radius,
            decision.stick.theta,
            decision.stick.fire,
            static_cast<std::int32_t>(decision.action),
            static_cast<std::int32_t>(decision.event),
            decision.strength};
}

int decide(cale_session* session, std::span<const std::uint8_t> observation, cale::Choice choice,
           cale_decision* decision) {
    *decision = plain(session->policy.act(observation, session->workspace, choice, session->random));
    return 1;
}

/// Calls show(observer, screen) with the caller's screen.
template <class Show>
int shown(cale_session* session, const std::uint8_t* screen, std::size_t size, Show&& show) noexcept {
    return guarded(0, [&] {
        auto& observer = observer_of(session);
        require(screen, "the screen");
        show(observer, std::span(screen, size));
        return 1;
    });
}

}  // namespace

int cale_policy_version(void) {
    return CALE_POLICY_VERSION;
}

cale_policy* cale_policy_load(const char* path) {
    return guarded<cale_policy*>(nullptr, [&] {
        require(path, "the path");
        return new cale_policy{cale::lite::Policy::load(path)};
    });
}

cale_policy* cale_policy_parse(const void* contents, size_t size) {
    return guarded<cale_policy*>(nullptr, [&] {
        require(contents, "the address of the contents");
        return new cale_policy{cale::lite::Policy::parse({static_cast<const char*>(contents), size})};
    });
}

void cale_policy_free(cale_policy* policy) {
    delete policy;
}

int cale_policy_get_info(const cale_policy* policy, cale_policy_info* info) {
    return guarded(0, [&] {
        require(policy, "the policy");
        require(info, "the place for the information");
        const auto& from = policy->policy.info();
        const auto number = [](std::int64_t value) { return static_cast<std::int32_t>(value); };
        *info = {number(from.num_actions()),
                 number(from.stack),
                 number(from.frame_height),
                 number(from.frame_width),
                 number(from.frame_skip),
                 number(from.life_loss_ends_episode),
                 from.threshold,
                 from.epsilon};
        return 1;
    });
}

const char* cale_policy_text(const cale_policy* policy, const char* name) {
    return guarded<const char*>(nullptr, [&]() -> const char* {
        require(policy, "the policy");
        require(name, "the name");
        const auto& info = policy->policy.info();
        const std::string_view wanted = name;
        if (wanted == "game") return info.game.c_str();
        if (wanted == "agent") return info.agent.c_str();
        if (wanted == "encoder") return info.encoder.c_str();
        if (wanted == "action_space") return info.action_space.c_str();
        if (wanted == "joystick") return cale::name_of(info.joystick).data();
        const auto found = info.provenance.find(name);
        return found == info.provenance.end() ? nullptr : found->second.c_str();
    });
}

cale_session* cale_session_new(const cale_policy* policy, int32_t screen_height, uint64_t seed) {
    return guarded<cale_session*>(nullptr, [&] {
        require(policy, "the policy");
        return new cale_session(policy->policy, screen_height, seed);
    });
}

void cale_session_free(cale_session* session) {
    delete session;
}

int cale_session_start(cale_session* session, const uint8_t* screen, size_t size) {
    return shown(session, screen, size, [&](auto& observer, auto pixels) {
        observer.start(pixels);
        session->started = true;
    });
}

int cale_session_see(cale_session* session, const uint8_t* screen, size_t size) {
    return shown(session, screen, size, [](auto& observer, auto pixels) { observer.see(pixels); });
}

int cale_session_lose_life(cale_session* session) {
    return guarded(0, [&] {
        observer_of(session).lose_life();
        return 1;
    });
}

int cale_session_due(const cale_session* session) {
    return session != nullptr && session->started && session->observer->due() ? 1 : 0;
}

int cale_session_act(cale_session* session, int choice, cale_decision* result) {
    return guarded(0, [&] {
        auto& observer = observer_of(session);
        require(result, "the place for the decision");
        const auto chosen = choice_of(choice);
        if (!session->started)
            throw std::logic_error("no game has begun in this session: call cale_session_start() first");
        return decide(session, observer.observation(), chosen, result);
    });
}

int cale_session_act_on(cale_session* session, const uint8_t* observation, size_t size, int choice,
                        cale_decision* result) {
    return guarded(0, [&] {
        require(session, "the session");
        require(observation, "the observation");
        require(result, "the place for the decision");
        return decide(session, {observation, size}, choice_of(choice), result);
    });
}

const char* cale_policy_error(void) {
    return last_error().c_str();
}
