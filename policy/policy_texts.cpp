#include "policy/policy_texts.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <type_traits>
#include <utility>
#include <vector>

#include "cale/text.h"

namespace cale {

std::string text_of(double value) {
    std::array<char, 64> text{};
    const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
    return {text.data(), end};
}

std::string take_text(Texts& texts, std::string_view key) {
    auto node = texts.extract(std::string(key));
    if (node.empty()) throw FileDamage({"its metadata '", key, "' is missing"});
    return std::move(node.mapped());
}

namespace {

std::string list_of(const std::vector<Event>& actions) {
    std::string text;
    for (const auto action : actions) text = joined({text, text.empty() ? "" : " ", event_name(action)});
    return text;
}

/// Visits every member that has a text of its own: one table for writing and for reading.
template <class Info, class Network, class Visit>
void describe(Info& info, Network& network, Visit&& visit) {
    visit("game", info.game);
    visit("agent", info.agent);
    visit("action_space", info.action_space);
    visit("actions", info.actions);
    visit("threshold", info.threshold, 0.0, 1.0);
    visit("event_map", info.event_map, names_of(EventMap{}));
    visit("paddle_radius", info.radius_is_strength);
    visit("stack", network.stack, 1, 64);
    visit("frame_height", network.frame_height, 1, 512);
    visit("frame_width", network.frame_width, 1, 512);
    visit("frame_skip", info.frame_skip, 1, 64);
    visit("life_loss_ends_episode", info.life_loss_ends_episode);
    visit("evaluation_samples", info.evaluation_samples);
    visit("epsilon", info.epsilon, 0.0, 1.0);
    static constexpr std::array<std::string_view, 3> encoders{"phi_sac", "phi_dqn", "impala"};
    visit("encoder", network.encoder, encoders);
    static constexpr std::array<std::string_view, 2> rows{"conv2d", "row1d"};
    visit("phi_dqn", network.phi_dqn, rows);
    static constexpr std::array<std::string_view, 2> paddings{"same", "valid"};
    visit("padding", network.padding, paddings);
    static constexpr std::array<std::string_view, 3> branches{"none", "actor", "shared"};
    visit("branch", network.branch, branches);
    visit("hidden_layers", network.hidden_layers, 0, 16);
    visit("hidden_units", network.hidden_units, 1, 65'536);
    static constexpr std::array<std::string_view, 2> activations{"relu", "tanh"};
    visit("activation", network.activation, activations);
    static constexpr std::array<std::string_view, 4> heads{"squashed_gaussian", "gaussian", "categorical",
                                                           "values"};
    visit("head", network.head, heads);
    visit("dueling", network.dueling);
    visit("num_atoms", network.num_atoms, 1, 10'000);
    visit("value_limit", network.value_limit, 0.0, 1e9);
}

struct Writer {
    Texts& texts;

    void operator()(const char* key, const std::string& value) const { texts[key] = value; }
    void operator()(const char* key, const std::vector<Event>& value) const { texts[key] = list_of(value); }
    void operator()(const char* key, bool value) const { texts[key] = value ? "true" : "false"; }
    void operator()(const char* key, double value, double, double) const { texts[key] = text_of(value); }
    void operator()(const char* key, std::int64_t value, int, int) const {
        texts[key] = std::to_string(value);
    }
    template <class Enum, class Names>
    void operator()(const char* key, Enum value, const Names& names) const {
        texts[key] = names[static_cast<std::size_t>(value)];
    }
};

/// Takes each text out of the map, so that what is left is provenance.
struct Reader {
    Texts& texts;

    void operator()(const char* key, std::string& value) const { value = take_text(texts, key); }
    void operator()(const char* key, std::vector<Event>& value) const {
        const auto text = take_text(texts, key);
        for (std::size_t begin = 0; begin < text.size();) {
            const auto end = std::min(text.find(' ', begin), text.size());
            value.push_back(event_of(key, text, text.substr(begin, end - begin)));
            begin = end + 1;
        }
        if (value.size() > kEventCount) refuse(key, text, "at most 18 joystick events");
    }
    void operator()(const char* key, bool& value) const {
        const auto text = take_text(texts, key);
        if (text != "true" && text != "false") refuse(key, text, "true or false");
        value = text == "true";
    }
    template <class Number, class Limit>
    requires(std::is_same_v<Number, double> || std::is_same_v<Number, std::int64_t>) void operator()(
        const char* key, Number& value, Limit low, Limit high) const {
        const auto text = take_text(texts, key);
        const auto number = number_in<Number>(text);
        if (!number || !(*number >= static_cast<Number>(low) && *number <= static_cast<Number>(high))) {
            refuse(key, text,
                   joined({std::is_same_v<Number, double> ? "a number from " : "a whole number from ",
                           text_of(static_cast<double>(low)), " to ", text_of(static_cast<double>(high))}));
        }
        value = *number;
    }
    template <class Enum, class Names>
    requires std::is_enum_v<Enum>
    void operator()(const char* key, Enum& value, const Names& names) const {
        const auto text = take_text(texts, key);
        const auto found = std::find(names.begin(), names.end(), text);
        std::string allowed;
        for (const auto name : names) allowed = joined({allowed, allowed.empty() ? "one of " : ", ", name});
        if (found == names.end()) refuse(key, text, allowed);
        value = static_cast<Enum>(found - names.begin());
    }

    [[noreturn]] static void refuse(const char* key, const std::string& text, const std::string& allowed) {
        throw FileDamage({"its metadata '", key, "' is ", in_quotes(text), ": it must be ", allowed});
    }

    static Event event_of(const char* key, const std::string& text, const std::string& name) {
        for (int i = 0; i < kEventCount; ++i)
            if (name == event_name(static_cast<Event>(i))) return static_cast<Event>(i);
        refuse(key, text, "joystick events by their names, with spaces between");
    }
};

/// That the head, the action space and the list of actions go together.
void check_actions(const PolicyInfo& info, const PolicyNetwork& network) {
    const auto& space = info.action_space;
    if (space != "continuous" && space != "minimal" && space != "full")
        Reader::refuse("action_space", space, "one of continuous, minimal, full");
    const bool continuous = space == "continuous";
    if (continuous != network.continuous())
        throw FileDamage({"its network's head does not act on the action space '", space, "'"});
    if (continuous != info.actions.empty()) {
        throw FileDamage({"the action space '", space, "' ",
                          (continuous ? "has no list of actions" : "needs a list of actions")});
    }
}

}  // namespace

Texts texts_of(const PolicyInfo& info, const PolicyNetwork& network) {
    Texts texts;
    describe(info, network, Writer{texts});
    return texts;
}

void read_texts(Texts& texts, PolicyInfo& info, PolicyNetwork& network) {
    if (const auto found = texts.find("encoder"); found != texts.end()) info.encoder = found->second;
    describe(info, network, Reader{texts});
    info.stack = network.stack;
    info.frame_height = network.frame_height;
    info.frame_width = network.frame_width;
    network.num_actions = info.num_actions();
    check_actions(info, network);
}

}  // namespace cale
