// The C interface. Input: the contents of a policy file; or, where it begins with "edit", changes to a good
// one: of each, two bytes say where (from the front, where the header is) and a third what to put there; or,
// where it begins with "observation", the network of a policy whose checksum is right.
#include <array>
#include <map>
#include <vector>

#include "fuzz.h"
#include "good_policy.h"
#include "policy/cale_policy.h"
#include "policy/network_text.h"

namespace {

/// The contents of a policy with this network, all of whose weights are zero; nothing where the text is none
/// of a network, or of a large one.
std::string policy_with(std::string_view text) {
    auto file = cale::parse_policy_file(fuzz::good_policy());
    auto& [info, network, weights, golden] = file;
    try {
        network = cale::parse_network(text);
    } catch (const cale::FileDamage&) {
        return "";
    }
    double numbers = 0;
    for (const auto& layer : cale::sized_layers(network)) {
        const auto window = std::max<std::int64_t>(layer.kernel_rows * layer.kernel_columns, 1);
        numbers += static_cast<double>(layer.out.count()) * static_cast<double>(window * layer.in.channels);
    }
    const auto parameters = cale::parameter_shapes(network);
    weights.clear();
    for (const auto& [name, shape] : parameters) {
        double count = 1;
        for (const auto size : shape) count *= static_cast<double>(size);
        if ((numbers += count) > 1e6) return "";
        weights[name].assign(static_cast<std::size_t>(count), 0);
    }
    set_observation(info, network.observation);
    if (network.head.continuous()) {
        info.action_space = "continuous";
        info.actions.clear();
        const std::map<std::int64_t, cale::Joystick> joysticks{
            {2, cale::Joystick::paddle}, {3, cale::Joystick::polar}, {4, cale::Joystick::direction}};
        if (!joysticks.contains(network.head.axes)) return "";
        info.joystick = joysticks.at(network.head.axes);
    } else {
        info.actions.resize(static_cast<std::size_t>(network.head.num_actions));
    }
    golden.observation = cale::golden_observation(info);
    golden.output.assign(static_cast<std::size_t>(cale::output_size(network.head)), 0);
    return cale::policy_file_contents(file);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    auto input = fuzz::text_of(data, size);
    std::string contents(input);
    if (input.starts_with("edit")) {
        fuzz::take(input, 4);
        contents = fuzz::good_policy();
        while (input.size() >= 3) {
            const auto place = fuzz::take_number(input, 2);
            contents[place % contents.size()] = fuzz::take(input, 1).front();
        }
    }
    if (input.starts_with("observation")) contents = policy_with(input);
    cale_policy* policy = cale_policy_parse(contents.data(), contents.size());
    if (policy == nullptr) {
        const std::string_view sentence = cale_policy_error();
        fuzz::require(sentence.size() > 10 && sentence.find('\n') == std::string_view::npos, "no sentence");
        return 0;
    }
    cale_policy_info info{};
    fuzz::require(cale_policy_get_info(policy, &info) == 1, "a policy without info");
    for (const auto* name : {"game", "agent", "encoder", "action_space", "no such name"})
        cale_policy_text(policy, name);
    if (cale_session* session = cale_session_new(policy, 210, 1)) {
        const std::vector<std::uint8_t> observation(
            static_cast<std::size_t>(info.stack * info.frame_height * info.frame_width), 9);
        cale_decision own{};
        fuzz::require(cale_session_act_on(session, observation.data(), observation.size(), CALE_AS_EVALUATED,
                                          &own) == 1,
                      "no decision");
        const std::vector<std::uint8_t> screen(210 * 160, 7);
        cale_decision decision{};
        if (cale_session_start(session, screen.data(), screen.size()) == 1)
            cale_session_act(session, static_cast<int>(size % 4), &decision);
        cale_session_see(session, screen.data(), size % screen.size());
        cale_session_free(session);
    }
    cale_policy_free(policy);
    return 0;
}
