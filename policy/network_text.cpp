#include "policy/network_text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <set>
#include <stdexcept>
#include <utility>

#include "cale/fields.h"
#include "cale/text.h"
#include "policy/json.h"
#include "policy/network_parameters.h"

namespace cale {

using Kind = Layer::Kind;

std::string number_text(double value) {
    std::array<char, 64> text{};
    const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
    return {text.data(), end};
}

namespace {

constexpr std::size_t kMostLayers = 1'000;
constexpr std::size_t kLongestName = 100;
constexpr std::int64_t kMostStack = 64, kMostPixels = 512, kMostBytes = 65'536;
constexpr std::int64_t kMostUnits = 65'536, kLargestWindow = 64;
constexpr std::int64_t kMostActions = 18, kMostAxes = 4, kMostAtoms = 10'000;
constexpr double kMostReturn = 1e9;
constexpr double kMostNumbers = 0x1p26, kMostSteps = 0x1p34;

struct KindName {
    Kind kind;
    std::string_view name;
};
constexpr KindName kKinds[] = {
    {Kind::conv, "conv"},       {Kind::max_pool, "max_pool"}, {Kind::relu, "relu"},
    {Kind::tanh, "tanh"},       {Kind::keep, "keep"},         {Kind::add_kept, "add_kept"},
    {Kind::flatten, "flatten"}, {Kind::dense, "dense"},       {Kind::layer_norm, "layer_norm"}};

std::string number(std::int64_t value) {
    return std::to_string(value);
}

// Writing -------------------------------------------------------------------------------

std::string layer_text(const Layer& layer) {
    const auto* const known =
        std::ranges::find_if(kKinds, [&](const KindName& kind) { return kind.kind == layer.kind; });
    std::string text(known->name);
    if (!layer.name.empty()) text += ' ' + layer.name;
    if (layer.outputs > 0) text += ' ' + number(layer.outputs);
    if (layer.kernel > 0) text += ' ' + number(layer.kernel) + ' ' + number(layer.stride);
    if (layer.kind == Kind::conv) {
        text.append(" ").append(layer.rows ? "rows" : name_of(layer.padding));
    }
    if (layer.noisy) text += " noisy";
    return text;
}

std::string head_text(const Head& head) {
    const auto axes = head.axes == Head{}.axes ? "" : ' ' + number(head.axes);
    switch (head.kind) {
        case Head::Kind::squashed_gaussian:
            return "squashed_gaussian" + axes;
        case Head::Kind::gaussian:
            return "gaussian" + axes;
        case Head::Kind::categorical:
            return "categorical " + number(head.num_actions);
        case Head::Kind::values:
            break;
    }
    std::string text = head.dueling ? "dueling_values " : "values ";
    text += number(head.num_actions) + ' ' + number(head.num_atoms) + ' ' + number_text(head.value_limit);
    if (head.noisy) text += " noisy";
    if (!head.factors.empty()) text += " factors";
    for (const auto factor : head.factors) text += ' ' + number(factor);
    return text;
}

// Reading -------------------------------------------------------------------------------

/// One entry of the text, word by word.
class EntryReader {
  public:
    explicit EntryReader(const std::string& entry) : entry_(entry), words_(split(entry, ' ')) {}

    std::string next() {
        if (now_ == words_.size()) refuse("ends too early");
        return words_[now_++];
    }
    std::int64_t whole(std::int64_t most) {
        const auto value = number_in<std::int64_t>(next());
        if (!value || *value < 1 || *value > most)
            refuse("has a number that is not from 1 to " + number(most));
        return *value;
    }
    double real(double most) {
        const auto value = number_in<double>(next());
        if (!value || !(*value >= 0 && *value <= most))
            refuse("has a number that is not from 0 to " + number_text(most));
        return *value;
    }
    std::string name() {
        auto word = next();
        const auto allowed = [](char c) {
            return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
                   c == '.';
        };
        if (word.empty() || word.size() > kLongestName || !std::ranges::all_of(word, allowed))
            refuse("has a name that is not made of letters, digits, _ and .");
        return word;
    }
    bool done() const { return now_ == words_.size(); }
    /// Takes the next word if it is this one.
    bool take(std::string_view word) {
        if (done() || words_[now_] != word) return false;
        ++now_;
        return true;
    }
    void end() const {
        if (!done()) refuse("has more to it than is known");
    }
    [[noreturn]] void refuse(const std::string& why) const {
        throw FileDamage({"its network's entry ", in_quotes(entry_), " ", why});
    }

  private:
    const std::string& entry_;
    std::vector<std::string> words_;
    std::size_t now_ = 0;
};

std::vector<std::int64_t> parse_observation(EntryReader entry) {
    if (entry.next() != "observation") entry.refuse("is not its observation, which is the first");
    std::vector<std::int64_t> shape{entry.whole(kMostStack)};
    shape.push_back(entry.whole(kMostBytes));
    if (!entry.done()) {
        if (shape.back() > kMostPixels) entry.refuse("has more than 512 rows");
        shape.push_back(entry.whole(kMostPixels));
    }
    entry.end();
    return shape;
}

Layer parse_layer(EntryReader entry) {
    const auto kind = entry.next();
    const auto* const known =
        std::ranges::find_if(kKinds, [&](const KindName& candidate) { return candidate.name == kind; });
    if (known == std::end(kKinds)) entry.refuse("is no layer that is known");
    Layer layer{.kind = known->kind};
    if (layer.kind == Kind::conv || layer.kind == Kind::dense || layer.kind == Kind::layer_norm)
        layer.name = entry.name();
    if (layer.kind == Kind::conv || layer.kind == Kind::dense) layer.outputs = entry.whole(kMostUnits);
    if (layer.kind == Kind::conv || layer.kind == Kind::max_pool) {
        layer.kernel = entry.whole(kLargestWindow);
        layer.stride = entry.whole(kLargestWindow);
    }
    if (layer.kind == Kind::conv) {
        const auto padding = entry.next();
        layer.rows = padding == "rows";
        layer.padding = padding == "valid" ? Padding::valid : Padding::same;
        if (!layer.rows && padding != "same" && padding != "valid")
            entry.refuse("is not padded as one of same, valid, rows");
    }
    if (layer.kind == Kind::dense) layer.noisy = entry.take("noisy");
    entry.end();
    return layer;
}

std::vector<std::int64_t> parse_factors(EntryReader& entry, std::int64_t num_actions) {
    std::vector<std::int64_t> factors;
    std::int64_t product = 1;
    do {
        factors.push_back(entry.whole(kMostActions));
        product *= factors.back();
    } while (!entry.done() && product <= num_actions && factors.back() > 1);
    if (product != num_actions || factors.back() == 1)
        entry.refuse("has factors whose product is not its number of actions");
    return factors;
}

Head parse_head(EntryReader entry) {
    const auto kind = entry.next();
    Head head;
    if (kind == "gaussian") head.kind = Head::Kind::gaussian;
    if (kind == "categorical") head.kind = Head::Kind::categorical;
    if (kind == "values" || kind == "dueling_values") head.kind = Head::Kind::values;
    if (head.kind == Head::Kind::squashed_gaussian && kind != "squashed_gaussian")
        entry.refuse(
            "is no head: its last entry must be one of squashed_gaussian, gaussian, categorical, values, "
            "dueling_values");
    if (!head.continuous()) head.num_actions = entry.whole(kMostActions);
    if (head.continuous() && !entry.done()) head.axes = entry.whole(kMostAxes);
    if (head.kind == Head::Kind::values) {
        head.dueling = kind == "dueling_values";
        head.num_atoms = entry.whole(kMostAtoms);
        head.value_limit = entry.real(kMostReturn);
        head.noisy = entry.take("noisy");
        if (entry.take("factors")) head.factors = parse_factors(entry, head.num_actions);
    }
    entry.end();
    return head;
}

std::vector<std::string> entries(std::string_view text) {
    // Before memory is allocated.
    if (std::cmp_greater_equal(std::ranges::count(text, ';'), kMostLayers))
        throw FileDamage("its network has more than 1000 layers");
    auto parts = split(text, ';');
    for (std::size_t i = 1; i < parts.size(); ++i) {
        if (!parts[i].starts_with(' ')) throw FileDamage("its network's entries are not separated by '; '");
        parts[i].erase(0, 1);
    }
    return parts;
}

void check_parameter_names(const NetworkSpec& network) {
    std::set<std::string> names;
    for (const auto& [name, shape] : parameter_shapes(network)) {
        // Each name once, and none of the golden pair's.
        if (name.starts_with("golden.") || !names.insert(name).second)
            throw FileDamage({"its network has a parameter that cannot be called ", in_quotes(name)});
    }
}

}  // namespace

void check_network(const NetworkSpec& network) {
    try {
        double numbers = 1, steps = 0;
        for (const auto size : network.observation) numbers *= static_cast<double>(size);
        std::int64_t zero_rows = 0, zero_columns = 0;  // that the next convolution wants around its image
        const auto layers = sized_layers(network);
        for (auto at = layers.rbegin(); at != layers.rend(); ++at) {
            const auto& layer = *at;
            const auto results = static_cast<double>(layer.out.count());
            numbers += static_cast<double>(layer.out.channels) *
                       static_cast<double>(layer.out.rows + zero_rows) *
                       static_cast<double>(layer.out.columns + zero_columns);
            const auto window = static_cast<double>(layer.kernel_rows * layer.kernel_columns);
            if (layer.kind == Kind::conv) steps += results * window * static_cast<double>(layer.in.channels);
            if (layer.kind == Kind::max_pool) steps += results * window;
            if (layer.noisy) numbers += static_cast<double>(layer.in.count()) + 2 * results;
            if (layer.kind != Kind::conv) continue;
            zero_rows = layer.top + layer.bottom;
            zero_columns = layer.left + layer.right;
        }
        if (numbers > kMostNumbers || steps > kMostSteps)
            throw FileDamage("its network is larger than one for a game has reason to be");
        check_parameter_names(network);
    } catch (const std::invalid_argument& error) {
        throw FileDamage({"its network's layers do not fit together: ", error.what()});
    }
}

std::string network_text(const NetworkSpec& network) {
    std::string text = "observation";
    for (const auto size : network.observation) text += ' ' + number(size);
    for (const auto& layer : network.layers) text += "; " + layer_text(layer);
    return text + "; " + head_text(network.head);
}

NetworkSpec parse_network(std::string_view text) {
    const auto parts = entries(text);
    if (parts.size() < 3) throw FileDamage("its network has no layers");
    NetworkSpec network{.observation = parse_observation(EntryReader(parts.front())),
                        .layers = {},
                        .head = parse_head(EntryReader(parts.back()))};
    for (std::size_t i = 1; i + 1 < parts.size(); ++i)
        network.layers.push_back(parse_layer(EntryReader(parts[i])));
    if (network_text(network) != text)  // reject 04 for 4
        throw FileDamage("its network is not written as cale export writes it");
    check_network(network);
    return network;
}

}  // namespace cale
