#include "policy/version_1.h"

#include <initializer_list>
#include <string>
#include <string_view>

#include "policy/encoder_layers.h"

namespace cale {
namespace {

std::string choice(Texts& texts, std::string_view key, std::initializer_list<std::string_view> allowed) {
    return take_choice(texts, key, {allowed.begin(), allowed.size()});
}

Layers trunk(const std::string& encoder, bool rows, Padding padding) {
    if (encoder == "phi_sac") return phi_sac(padding);
    if (encoder == "phi_dqn") return phi_dqn(padding, rows);
    return impala();
}

Layers branch(const std::string& kind, const std::string& encoder) {
    if (kind == "none") return {};
    if (kind == "shared") return {Layer::dense("fc", 512), Layer::of(Layer::Kind::relu)};
    return encoder == "phi_sac" ? tanh_branch("actor") : relu_branch("actor", /*layer_norm=*/false);
}

Head::Kind head_kind(const std::string& name) {
    if (name == "squashed_gaussian") return Head::Kind::squashed_gaussian;
    if (name == "gaussian") return Head::Kind::gaussian;
    return name == "categorical" ? Head::Kind::categorical : Head::Kind::values;
}

}  // namespace

NetworkSpec take_network_of_version_1(Texts& texts) {
    NetworkSpec network;
    network.observation = {take_whole(texts, "stack", 1, 64), take_whole(texts, "frame_height", 1, 512),
                           take_whole(texts, "frame_width", 1, 512)};
    const auto encoder = choice(texts, "encoder", {"phi_sac", "phi_dqn", "impala"});
    texts["encoder"] = encoder;
    const bool rows = choice(texts, "phi_dqn", {"conv2d", "row1d"}) == "row1d";
    const auto padding =
        choice(texts, "padding", {"same", "valid"}) == "valid" ? Padding::valid : Padding::same;
    const auto behind = choice(texts, "branch", {"none", "actor", "shared"});
    const auto count = take_whole(texts, "hidden_layers", 0, 16);
    const auto units = take_whole(texts, "hidden_units", 1, 65'536);
    const auto activation =
        choice(texts, "activation", {"relu", "tanh"}) == "tanh" ? Layer::Kind::tanh : Layer::Kind::relu;
    auto& head = network.head;
    head.kind = head_kind(choice(texts, "head", {"squashed_gaussian", "gaussian", "categorical", "values"}));
    const bool dueling = take_truth(texts, "dueling");
    const auto atoms = take_whole(texts, "num_atoms", 1, 10'000);
    const auto limit = take_real(texts, "value_limit", 0, 1e9);
    const bool values = head.kind == Head::Kind::values;
    if (values) head = {.kind = head.kind, .dueling = dueling, .num_atoms = atoms, .value_limit = limit};
    network.layers =
        chain({prefixed("encoder.", chain({trunk(encoder, rows, padding), branch(behind, encoder)})),
               prefixed(values ? "head." : "actor.", hidden_layers(count, units, activation))});
    return network;
}

}  // namespace cale
