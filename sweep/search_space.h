// What a search draws settings from: the `search` section of a sweep file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace cale {

/// A setting of a run: "agent.encoder" and "phi_sac".
struct Setting {
    std::string key;
    std::string value;
    bool operator==(const Setting&) const = default;
};

/// Numbers between two ends, all equally likely; with `logarithmic` their logarithms are.
struct NumberRange {
    double low = 0, high = 0;
    bool logarithmic = false;
    bool whole = false;  // integers alone, both ends among them
};
/// Values that are equally likely.
using Choices = std::vector<std::string>;

/// A setting that is drawn.
struct SearchedSetting {
    std::string key;  // "agent.learning_rate"
    std::variant<NumberRange, Choices> values;
    std::string place{};  // "mine.yaml:9:3"; empty: it is of a command line
};

/// What a search draws settings from.
struct SearchSpace {
    std::int64_t samples = 0;  // sets of settings to draw
    std::uint64_t seed = 1;
    std::optional<std::int64_t> first_steps{};  // agent steps before the first halving; none: see rungs()
    std::vector<SearchedSetting> settings{};
};

/// Returns the range that a text stands for: "1..10" integers, "0.1..0.9" numbers, "log 1e-5..1e-3"; none
/// where it is no range. Throws ConfigError for a range that is empty, of one value, or no range of
/// logarithms.
std::optional<NumberRange> number_range(std::string_view text);

/// Returns the settings of each sample, in the order of the space; numbers have three digits that can differ.
/// A sample depends on the seed, its number and the settings alone, but for one that would repeat an earlier
/// one, which is drawn again. Throws ConfigError where a thousand draws find no new one: the space has fewer
/// samples than it is to give, or hardly more.
std::vector<std::vector<Setting>> draw_samples(const SearchSpace& space);

}  // namespace cale
