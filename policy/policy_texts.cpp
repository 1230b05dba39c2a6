#include "policy/policy_texts.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "cale/fields.h"
#include "cale/text.h"
#include "policy/json.h"
#include "policy/network_text.h"
#include "policy/version_1.h"

namespace cale {
namespace {

constexpr const char* kNetwork = "network";

[[noreturn]] void refuse(std::string_view key, const std::string& text, const std::string& allowed) {
    throw FileDamage({"its metadata '", key, "' is ", in_quotes(text), ": it must be ", allowed});
}

/// Takes a number from `low` to `high`, of which `what` says of what kind.
template <class Number>
Number take_number(Texts& texts, std::string_view key, Number low, Number high, std::string_view what) {
    const auto text = take_text(texts, key);
    const auto number = number_in<Number>(text);
    // Written so that NaN, which compares false to everything, is refused too.
    if (!number || !(*number >= low && *number <= high)) {
        refuse(key, text,
               concatenated({what, " from ", number_text(static_cast<double>(low)), " to ",
                             number_text(static_cast<double>(high))}));
    }
    return *number;
}

}  // namespace

std::string take_text(Texts& texts, std::string_view key) {
    auto node = texts.extract(std::string(key));
    if (node.empty()) throw FileDamage({"its metadata '", key, "' is missing"});
    return std::move(node.mapped());
}

std::string take_choice(Texts& texts, std::string_view key, std::span<const std::string_view> allowed) {
    auto text = take_text(texts, key);
    if (std::ranges::find(allowed, text) != allowed.end()) return text;
    std::string names;
    for (const auto name : allowed) names = concatenated({names, names.empty() ? "one of " : ", ", name});
    refuse(key, text, names);
}

bool take_truth(Texts& texts, std::string_view key) {
    const auto text = take_text(texts, key);
    if (text != "true" && text != "false") refuse(key, text, "true or false");
    return text == "true";
}

std::int64_t take_whole(Texts& texts, std::string_view key, std::int64_t low, std::int64_t high) {
    return take_number(texts, key, low, high, "a whole number");
}

double take_real(Texts& texts, std::string_view key, double low, double high) {
    return take_number(texts, key, low, high, "a number");
}

namespace {

std::string list_of(const std::vector<Event>& actions) {
    std::string text;
    for (const auto action : actions)
        text = concatenated({text, text.empty() ? "" : " ", event_name(action)});
    return text;
}

Event event_called(const std::string& name, const std::string& text) {
    for (int i = 0; i < kEventCount; ++i)
        if (name == event_name(static_cast<Event>(i))) return static_cast<Event>(i);
    refuse("actions", text, "joystick events by their names, with spaces between");
}

/// Visits every member that has a text of its own: one table for writing and for reading.
template <class Info, class Visit>
void describe(Info& info, Visit&& visit) {
    visit("game", info.game);
    visit("agent", info.agent);
    visit("encoder", info.encoder);
    visit("action_space", info.action_space);
    visit("actions", info.actions);
    visit("joystick", info.joystick);
    visit("threshold", info.threshold);
    visit("event_map", info.event_map);
    visit("paddle_radius", info.radius_is_strength);
    visit("frame_skip", info.frame_skip);
    visit("life_loss_ends_episode", info.life_loss_ends_episode);
    visit("evaluation_samples", info.evaluation_samples);
    visit("epsilon", info.epsilon);
}

struct Writer {
    Texts& texts;

    void operator()(const char* key, const std::string& value) const { texts[key] = value; }
    void operator()(const char* key, const std::vector<Event>& value) const { texts[key] = list_of(value); }
    void operator()(const char* key, bool value) const { texts[key] = value ? "true" : "false"; }
    void operator()(const char* key, double value) const { texts[key] = number_text(value); }
    void operator()(const char* key, std::int64_t value) const { texts[key] = std::to_string(value); }
    void operator()(const char* key, Joystick value) const {
        if (value != Joystick::polar) texts[key] = name_of(value);
    }
    void operator()(const char* key, EventMap value) const { texts[key] = name_of(value); }
};

/// Takes each text out of the map, so that what is left is provenance.
struct Reader {
    Texts& texts;

    void operator()(const char* key, std::string& value) const { value = take_text(texts, key); }
    void operator()(const char* key, std::vector<Event>& value) const {
        const auto text = take_text(texts, key);
        if (text.empty()) return;
        // Before memory is allocated.
        if (std::ranges::count(text, ' ') >= kEventCount) refuse(key, text, "at most 18 joystick events");
        for (const auto& name : split(text, ' ')) value.push_back(event_called(name, text));
    }
    void operator()(const char* key, bool& value) const { value = take_truth(texts, key); }
    // The threshold and epsilon.
    void operator()(const char* key, double& value) const { value = take_real(texts, key, 0, 1); }
    // The frames per decision.
    void operator()(const char* key, std::int64_t& value) const { value = take_whole(texts, key, 1, 64); }
    // Is missing from the files of polar policies, which are older than it.
    void operator()(const char* key, Joystick& value) const {
        if (!texts.contains(key)) return;
        value = take_value<Joystick>(key, 1);
    }
    void operator()(const char* key, EventMap& value) const { value = take_value<EventMap>(key); }

    template <class Value>
    Value take_value(const char* key, std::size_t first = 0) const {
        const auto names = names_of(Value{}).subspan(first);
        const auto found = std::ranges::find(names, take_choice(texts, key, names));
        return static_cast<Value>(static_cast<std::size_t>(found - names.begin()) + first);
    }
};

/// That the head, the action space and the list of actions go together.
void check_actions(const PolicyInfo& info, const Head& head) {
    const auto& space = info.action_space;
    if (space != "continuous" && space != "minimal" && space != "full")
        refuse("action_space", space, "one of continuous, minimal, full");
    const bool continuous = space == "continuous", factored = info.joystick == Joystick::factored;
    if (!continuous && info.joystick != Joystick::polar)
        throw FileDamage({"the action space '", space, "' has no coordinates of a joystick"});
    const bool coordinates = continuous && !factored;
    if (coordinates != head.continuous())
        throw FileDamage({"its network's head does not act on the action space '", space, "'"});
    if (coordinates && head.axes != std::ssize(stick_coordinates(info.joystick)))
        throw FileDamage({"its network's head has ", std::to_string(head.axes),
                          " coordinates, and its joystick ",
                          std::to_string(stick_coordinates(info.joystick).size())});
    if (coordinates != info.actions.empty()) {
        throw FileDamage({"the action space '", space, "' ",
                          (coordinates ? "has no list of actions" : "needs a list of actions")});
    }
    if (factored && !std::ranges::equal(info.actions, factored_events()))
        throw FileDamage("its list of actions is not that of the factored joystick");
    if (head.num_actions != info.num_actions())
        throw FileDamage({"its network's head has another number of actions than are listed: ",
                          std::to_string(head.num_actions), ", not ", std::to_string(info.num_actions())});
}

}  // namespace

Texts texts_of(const PolicyInfo& info, const NetworkSpec& network) {
    Texts texts;
    describe(info, Writer{texts});
    texts[kNetwork] = network_text(network);
    return texts;
}

void read_texts(Texts& texts, bool version_1, PolicyInfo& info, NetworkSpec& network) {
    // What of version 1 became the network is taken first: it takes `encoder` for one of three.
    if (version_1) network = take_network_of_version_1(texts);
    describe(info, Reader{texts});
    for (const auto& [key, text] : {std::pair{"game", info.game}, {"encoder", info.encoder}})
        if (printable(text) != text) refuse(key, text, "without control characters");
    if (!is_agent_name(info.agent)) refuse("agent", info.agent, "at most 64 letters, digits, '_' and '-'");
    if (version_1) {
        if (!network.head.continuous()) network.head.num_actions = info.num_actions();
        check_network(network);
    } else {
        network = parse_network(take_text(texts, kNetwork));
    }
    check_actions(info, network.head);
    set_observation(info, network.observation);
}

}  // namespace cale
