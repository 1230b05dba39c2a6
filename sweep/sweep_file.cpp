#include "sweep/sweep_file.h"

#include <algorithm>
#include <climits>
#include <map>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/yaml.h>

#include "cale/games.h"
#include "cale/text.h"
#include "report/runs.h"
#include "settings/config.h"
#include "settings/yaml.h"
#include "sweep/grid.h"
#include "sweep/settings.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

struct Contents {
    Grid common{};  // agent, config and `set`
    Grid grid{};
    std::vector<Grid> variants{};
    std::optional<SearchSpace> search{};
};

constexpr std::int64_t kMostSamples = 10'000, kLargestSeed = 2'147'483'647, kMostSteps = 1'000'000'000'000;

bool is_setting(std::string_view key) {
    const auto dot = key.find('.');
    return dot != key.npos && dot > 0 && dot + 1 < key.size();
}

bool is_key(std::string_view key) {
    return key == "agent" || key == "config" || is_setting(key);
}

std::string no_key(std::string_view key) {
    return fmt::format(
        "'{}' is no key: settings are written section.name, such as env.game; beside them there are agent "
        "and config",
        key);
}

// ---- the file -----------------------------------------------------------------------

class Reader {
  public:
    explicit Reader(fs::path file) : file_(std::move(file)) {}

    Contents read() const {
        Contents contents;
        const auto root = parse_yaml(file_, read_yaml(file_));
        check_map(root, "a sweep file has 'grid:' with the keys that vary below");
        for (const auto& item : root) {
            const auto section = word(item.first);
            if (section == "agent" || section == "config") {
                if (item.second.IsSequence())
                    fail(item.second,
                         fmt::format("'{}' has several values: what varies goes below 'grid:'", section));
                contents.common.push_back({section, {word(item.second)}});
            } else if (section == "set") {
                for (auto& axis : grid(item.second)) {
                    if (axis.values.size() > 1)
                        fail(
                            item.second,
                            fmt::format("'{}' has several values: what varies goes below 'grid:'", axis.key));
                    contents.common.push_back(std::move(axis));
                }
            } else if (section == "grid") {
                contents.grid = grid(item.second);
            } else if (section == "variants") {
                if (!item.second.IsSequence())
                    fail(item.second, "'variants' is a list of grids: '- key: value'");
                for (const auto& variant : item.second) contents.variants.push_back(grid(variant));
            } else if (section == "search") {
                contents.search = search(item.second);
            } else {
                fail_unknown(item.first, {"agent", "config", "set", "grid", "variants", "search"});
            }
        }
        for (const auto* key : {"agent", "config"}) {
            if (std::ranges::count(contents.common, key, &Axis::key) > 1)
                fail(root,
                     fmt::format("'{}' is there twice, at the top and below 'set:'; leave one out", key));
        }
        check_sections(contents);
        return contents;
    }

  private:
    /// A key that varies is in one section.
    void check_sections(Contents& contents) const {
        const auto refuse_repeated = [&](Grid& grid, const std::string& key, const char* first,
                                         const char* second) {
            if (find(grid, key) == nullptr) return;
            throw ConfigError(fmt::format("{}: '{}' is in '{}' and in '{}'; leave it in one of them",
                                          file_.string(), key, first, second));
        };
        for (const auto& variant : contents.variants) {
            for (const auto& axis : variant) refuse_repeated(contents.grid, axis.key, "grid", "variants");
        }
        if (!contents.search) return;
        for (const auto& setting : contents.search->settings) {
            refuse_repeated(contents.grid, setting.key, "grid", "search");
            for (auto& variant : contents.variants)
                refuse_repeated(variant, setting.key, "variants", "search");
        }
    }

    [[noreturn]] void fail_unknown(const YAML::Node& key, const std::vector<std::string>& known) const {
        const auto name = word(key);
        for (const auto* section : {"env", "train", "eval", "log", "extends"}) {
            if (name == section)
                fail(key,
                     fmt::format(
                         "'{}' is of a configuration, which a sweep file names by 'config: FILE'; single "
                         "settings, such as env.game, go below 'set:' and 'grid:'",
                         name));
        }
        const auto guess = nearest(name, known);
        fail(key, fmt::format("unknown key '{}'; {}", name,
                              guess.empty() ? fmt::format("there are {}", fmt::join(known, ", "))
                                            : fmt::format("did you mean '{}'?", guess)));
    }
    [[noreturn]] void fail(const YAML::Node& node, const std::string& what) const {
        fail_at(file_, node.Mark(), what);
    }

    void check_map(const YAML::Node& node, const std::string& expected) const {
        if (!node.IsMap()) fail(node, expected);
        std::map<std::string, int> seen;
        for (const auto& item : node) {
            const auto [found, is_new] = seen.emplace(word(item.first), item.first.Mark().line + 1);
            if (!is_new)
                fail(item.first, fmt::format("'{}' is there a second time; line {} has the first",
                                             found->first, found->second));
        }
    }

    std::string word(const YAML::Node& node) const {
        if (node.IsNull()) fail(node, "there is no value; write none where a setting is to have none");
        if (!node.IsScalar()) fail(node, "expected a single word or number");
        return node.Scalar();
    }

    Grid grid(const YAML::Node& node) const {
        check_map(node, "expected keys with their values, one per line: 'env.game: [pong, breakout]'");
        Grid axes;
        for (const auto& item : node) {
            const auto key = word(item.first);
            if (!is_key(key)) fail(item.first, no_key(key));
            std::vector<std::string> texts;
            if (item.second.IsSequence()) {
                for (const auto& value : item.second) texts.push_back(word(value));
            } else {
                texts.push_back(word(item.second));
            }
            if (texts.empty()) fail(item.second, fmt::format("'{}' has no values", key));
            try {
                axes.push_back({key, expand(key, texts), place(file_, item.first.Mark())});
            } catch (const ConfigError& error) {
                fail(item.second, error.what());
            }
        }
        return axes;
    }

    std::int64_t integer(const YAML::Node& node, std::int64_t low, std::int64_t high) const {
        const auto number = if_integer(word(node));
        if (number && *number >= low && *number <= high) return *number;
        fail(node, fmt::format("expected an integer, {} to {}, not '{}'", low, high, word(node)));
    }

    SearchSpace search(const YAML::Node& node) const {
        check_map(node,
                  "'search' has 'samples:', how many sets of settings to draw, and 'settings:', what from");
        SearchSpace space;
        for (const auto& item : node) {
            const auto key = word(item.first);
            if (key == "samples") {
                space.samples = integer(item.second, 1, kMostSamples);
            } else if (key == "seed") {
                space.seed = static_cast<std::uint64_t>(integer(item.second, 0, kLargestSeed));
            } else if (key == "first_steps") {
                space.first_steps = integer(item.second, 1, kMostSteps);
            } else if (key == "settings") {
                space.settings = searched_settings(item.second);
            } else {
                fail_unknown(item.first, {"samples", "seed", "first_steps", "settings"});
            }
        }
        if (space.samples == 0) fail(node, "'search' lacks 'samples:', how many sets of settings to draw");
        if (space.settings.empty())
            fail(node, "'search' lacks 'settings:', the settings to draw and from what");
        return space;
    }

    std::vector<SearchedSetting> searched_settings(const YAML::Node& node) const {
        constexpr const char* expected =
            "expected settings and what they are drawn from: 'agent.learning_rate: log 1e-5..1e-3', '1..10' "
            "or a list";
        check_map(node, expected);
        std::vector<SearchedSetting> settings;
        for (const auto& item : node) {
            const auto key = word(item.first);
            if (!is_setting(key)) fail(item.first, no_key(key));
            if (is_game_or_seed(key))
                fail(item.first, fmt::format("'{}' is not searched: it goes below 'grid:'", key));
            SearchedSetting setting{
                .key = key, .values = Choices(), .place = place(file_, item.first.Mark())};
            if (item.second.IsSequence()) {
                Choices choices;
                for (const auto& value : item.second) choices.push_back(word(value));
                if (choices.empty()) fail(item.second, fmt::format("'{}' has no values", key));
                setting.values = std::move(choices);
            } else {
                setting.values = range(item.second, expected);
            }
            settings.push_back(std::move(setting));
        }
        return settings;
    }

    NumberRange range(const YAML::Node& node, const char* expected) const {
        try {
            if (const auto found = number_range(word(node))) return *found;
        } catch (const ConfigError& error) {
            fail(node, error.what());
        }
        fail(node, fmt::format("'{}' is no range; {}", word(node), expected));
    }

    fs::path file_;
};

// ---- the command line ---------------------------------------------------------------

/// Returns false where the key is not searched.
bool override_searched(SearchSpace& space, const std::string& key, const std::string& values) {
    const auto setting = std::ranges::find(space.settings, key, &SearchedSetting::key);
    if (setting == space.settings.end()) return false;
    *setting = {.key = key, .values = split(values, ',')};
    if (const auto range = number_range(values)) setting->values = *range;
    return true;
}

/// Puts the axis in the place of the one with its key, in the grid and in the variants; where there is none,
/// adds it: one value to what all runs have in common, several to what varies.
void put(Contents& contents, const Axis& axis) {
    if (auto* in_grid = find(contents.grid, axis.key)) {
        *in_grid = axis;
        return;
    }
    std::vector<Grid*> others;  // variants without the key
    for (auto& variant : contents.variants) {
        auto* const found = find(variant, axis.key);
        if (found == nullptr) {
            others.push_back(&variant);
        } else {
            *found = axis;
        }
    }
    if (axis.values.size() == 1) {
        if (auto* common = find(contents.common, axis.key)) {
            *common = axis;
        } else {
            contents.common.push_back(axis);
        }
    } else if (others.size() == contents.variants.size()) {
        contents.grid.push_back(axis);
    } else {
        for (auto* other : others) other->push_back(axis);
    }
}

void override_key(Contents& contents, const std::string& text) {
    const auto equals = text.find('=');
    const auto key = text.substr(0, equals);
    if (equals == std::string::npos)
        throw ConfigError(fmt::format("'{}': expected KEY=VALUE, such as env.game=pong,breakout", text));
    if (!is_key(key)) throw ConfigError(no_key(key));
    Axis axis{key, split(text.substr(equals + 1), ',')};
    // An empty text is a value of some settings.
    const bool may_be_empty = axis.values.size() == 1 && is_setting(key) && key != "train.seed";
    if (!may_be_empty && std::ranges::find(axis.values, "") != axis.values.end())
        throw ConfigError(fmt::format("{}: a value is missing", text));
    try {
        if (contents.search && override_searched(*contents.search, key, text.substr(equals + 1))) return;
        axis.values = expand(key, axis.values);
    } catch (const ConfigError& error) {
        throw ConfigError(fmt::format("{}: {}", text, error.what()));
    }
    if (key == "config") {
        for (auto& value : axis.values) value = fs::absolute(value).string();
    }
    put(contents, axis);
}

// ---- the runs -----------------------------------------------------------------------

std::string last_part(const std::string& key) {
    return key.substr(key.find('.') + 1);
}

/// For names of folders: "encoder", or "eval.noop_max" where another key is called noop_max, too.
std::map<std::string, std::string> short_keys(const Contents& contents) {
    std::map<std::string, std::string> keys;
    for (const auto& axis : contents.grid) keys[axis.key] = last_part(axis.key);
    for (const auto& variant : contents.variants) {
        for (const auto& axis : variant) keys[axis.key] = last_part(axis.key);
    }
    for (auto& entry : keys) {
        const auto same = [&](const auto& other) { return last_part(other.first) == last_part(entry.first); };
        if (std::count_if(keys.begin(), keys.end(), same) > 1) entry.second = entry.first;
    }
    return keys;
}

/// Fit for the name of a folder, and free of the wildcards of --only.
std::string file_name(std::string_view text) {
    std::string result;
    for (const char c : text) {
        const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
        result += plain || std::string_view("._+-").find(c) != std::string_view::npos ? c : '-';
    }
    return result;
}

/// Where the file has each of its settings.
std::map<std::string, std::string> places_of(const Contents& contents,
                                             const std::vector<std::vector<Setting>>& samples) {
    std::map<std::string, std::string> places;
    const auto add = [&](const Grid& grid) {
        for (const auto& axis : grid) {
            if (axis.place.empty()) continue;
            for (const auto& value : axis.values) places.emplace(assignment({axis.key, value}), axis.place);
        }
    };
    add(contents.common);
    add(contents.grid);
    for (const auto& variant : contents.variants) add(variant);
    if (!contents.search) return places;
    for (std::size_t i = 0; i < contents.search->settings.size(); ++i) {
        const auto& place = contents.search->settings[i].place;
        if (place.empty()) continue;
        for (const auto& sample : samples) places.emplace(assignment(sample[i]), place);
    }
    return places;
}

class RunMaker {
  public:
    RunMaker(const fs::path& file, const Contents& contents)
        : file_(file), contents_(contents), short_keys_(short_keys(contents)) {}

    /// `sample`: its number, from 1, and `drawn`, its settings; 0 without a search.
    SweepRun make(const std::vector<Setting>& varying, std::int64_t sample,
                  const std::vector<Setting>& drawn) const {
        SweepRun run;
        run.sample = sample;
        std::string agent, config, seed, middle;
        const auto take = [&](const std::string& key, const std::string& value) {
            if (key == "agent") {
                agent = value;
            } else if (key == "config") {
                config = value;
            } else {
                run.settings.push_back({key, value});
            }
        };
        for (const auto& axis : contents_.common) {
            const auto same = [&](const Setting& setting) { return setting.key == axis.key; };
            if (std::ranges::none_of(varying, same) && std::ranges::none_of(drawn, same))
                take(axis.key, axis.values.front());
        }
        for (const auto& [key, value] : varying) {
            take(key, value);
            if (key == "agent" || is_game_or_seed(key)) continue;
            const auto shown = key == "config" ? fs::path(value).stem().string() : value;
            middle += fmt::format("__{}={}", file_name(short_keys_.at(key)), file_name(shown));
        }
        for (const auto& [key, value] : drawn) take(key, value);
        for (const auto& [key, value] : run.settings) {
            if (key == "env.game") run.game = find_game(value).name;
            if (key == "train.seed") seed = value;
        }
        if (agent.empty()) missing("agent", "agent: sac");
        if (run.game.empty()) missing("env.game", "env.game: [pong, breakout]", run.settings);
        if (seed.empty()) missing("train.seed", "train.seed: 1..5", run.settings);
        run.agent = agent;
        if (!config.empty()) {
            constexpr std::string_view kAgent = "{agent}";
            for (std::size_t at = 0; (at = config.find(kAgent, at)) != std::string::npos; at += agent.size())
                config.replace(at, kAgent.size(), agent);
            // `..` behind a link is the parent of what that leads to.
            run.config =
                (fs::weakly_canonical(fs::absolute(file_).parent_path()) / config).lexically_normal();
        }
        const auto name = [&](const std::string& of_sample) {
            return fmt::format("{}__{}{}{}__{}", run.game, file_name(agent), middle, of_sample,
                               file_name(seed));
        };
        run.combination = name("");
        run.name = sample > 0 ? name(fmt::format("__sample={}", sample)) : run.combination;
        if (run.name.size() > NAME_MAX)
            throw ConfigError(fmt::format(
                "{}: a run's folder would have a name of {} bytes, '{:.60}...', and {} are allowed: "
                "let fewer keys vary, or shorter values",
                file_.string(), run.name.size(), run.name, NAME_MAX));
        return run;
    }

  private:
    /// `settings`: those of a run, of which one may be the key misspelt.
    [[noreturn]] void missing(std::string_view key, std::string_view example,
                              const std::vector<Setting>& settings = {}) const {
        std::vector<std::string> keys(settings.size());
        std::ranges::transform(settings, keys.begin(), &Setting::key);
        const auto misspelt = nearest(key, keys);
        const auto remedy = misspelt.empty() ? fmt::format("add '{}'", example)
                                             : fmt::format("did you mean it by '{}'?", misspelt);
        throw ConfigError(fmt::format("{}: {} is missing; {}", file_.string(), key, remedy));
    }

    const fs::path& file_;
    const Contents& contents_;
    std::map<std::string, std::string> short_keys_;
};

/// Returns what `make` returns; its ConfigError names the file.
template <class Make>
auto with_file(const fs::path& file, const Make& make) {
    try {
        return make();
    } catch (const ConfigError& error) {
        throw ConfigError(fmt::format("{}: {}", file.string(), error.what()));
    }
}

}  // namespace

std::string assignment(const Setting& setting) {
    return fmt::format("{}={}", setting.key, setting.value);
}

Sweep read_sweep(const fs::path& file, std::span<const std::string> overrides) {
    auto contents = Reader(file).read();
    for (const auto& text : overrides) override_key(contents, text);

    Sweep sweep{.name = file.stem().string(), .search = contents.search};
    if (contents.search) sweep.samples = with_file(file, [&] { return draw_samples(*contents.search); });
    sweep.places = places_of(contents, sweep.samples);
    const RunMaker maker(file, contents);
    std::map<std::string, std::size_t> seen;
    const auto add = [&](SweepRun run) {
        const auto [found, is_new] = seen.emplace(run.name, sweep.runs.size());
        if (is_new) {
            sweep.runs.push_back(std::move(run));
            return;
        }
        // Variants may overlap.
        const auto& other = sweep.runs[found->second];
        if (other.settings != run.settings || other.config != run.config) {
            throw ConfigError(fmt::format(
                "{}: two different runs would be called {}; give them values that differ in their names",
                file.string(), run.name));
        }
        ++sweep.repeated;
    };
    const auto all = with_file(file, [&] { return combinations(contents.grid, contents.variants); });
    if (all.size() * std::max<std::size_t>(1, sweep.samples.size()) > kMostRuns)
        throw ConfigError(fmt::format("{}: more than {} runs", file.string(), kMostRuns));
    for (const auto& varying : all) {
        if (!contents.search) add(maker.make(varying, 0, {}));
        for (std::size_t i = 0; i < sweep.samples.size(); ++i)
            add(maker.make(varying, static_cast<std::int64_t>(i) + 1, sweep.samples[i]));
    }
    return sweep;
}

}  // namespace cale
