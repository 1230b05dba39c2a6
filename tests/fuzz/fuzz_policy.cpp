// The C interface. Input: the contents of a policy file; or, where it begins with "edit", changes to a good
// one: of each, two bytes say where (from the front, where the header is) and a third what to put there.
#include <array>
#include <vector>

#include "fuzz.h"
#include "good_policy.h"
#include "policy/cale_policy.h"

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
