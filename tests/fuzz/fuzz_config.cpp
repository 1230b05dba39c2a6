// The YAML reader and KEY=VALUE. Input: a configuration file; what follows a line "---set" is one override a
// line.
#include "agents/sac.h"
#include "fuzz.h"
#include "settings/config.h"
#include "settings/run_config.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const fuzz::Folder folder;
    const auto input = fuzz::text_of(data, size);
    const auto end = input.find("---set\n");

    cale::RunConfig<cale::SacConfig> config;
    cale::ConfigTable table;
    table.add("env", config.env);
    table.add("agent", config.agent);
    table.add("train", config.train);
    table.add("eval", config.eval);
    table.add("log", config.log);
    // "extends: input.yaml" and "extends: other.yaml" find something.
    folder.write("other.yaml", "train: {seed: 7}\n");
    const auto file = folder.write("input.yaml", input.substr(0, end));
    fuzz::accepts([&] { table.load(file); });
    if (end != std::string_view::npos) {
        auto overrides = input.substr(end + 7);
        while (!overrides.empty()) {
            const auto line = fuzz::take(overrides, overrides.find('\n'));
            fuzz::take(overrides, 1);
            fuzz::accepts([&] { table.set_override(std::string(line)); });
        }
    }
    // Whatever was accepted can be written and read again.
    const auto again = folder.write("again.yaml", table.to_yaml());
    bool same = false;
    fuzz::require(fuzz::accepts([&] { same = table.differences(again).empty(); }), "its own YAML is refused");
    fuzz::require(same, "its own YAML means something else");
    return 0;
}
