#include "sweep/search_space.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <fmt/format.h>

#include "cale/seeds.h"
#include "cale/text.h"
#include "settings/config.h"
#include "sweep/settings.h"

namespace cale {
namespace {

constexpr int kMostAttempts = 1000;

/// The same on every machine, as the standard library's distributions are not.
double uniform(std::mt19937_64& random) {
    return static_cast<double>(random() >> 11) * 0x1p-53;
}

std::string drawn(const Choices& choices, std::mt19937_64& random) {
    return choices[static_cast<std::size_t>(uniform(random) * static_cast<double>(choices.size()))];
}

std::string drawn(const NumberRange& range, std::mt19937_64& random) {
    // An integer has its whole unit of the range.
    const double margin = range.whole ? 0.5 : 0;
    double low = range.low - margin, high = range.high + margin;
    if (range.logarithmic) {
        low = std::log(low);
        high = std::log(high);
    }
    double value = low + (high - low) * uniform(random);
    if (range.logarithmic) value = std::exp(value);
    if (range.whole)  // + 0.0: no "-0"
        return fmt::format("{:.0f}", std::clamp(std::round(value), range.low, range.high) + 0.0);
    // Three digits, and as many more as the ends have in common.
    const double spread = (range.high - range.low) / std::max(std::abs(range.low), std::abs(range.high));
    const int digits = 3 + static_cast<int>(std::max(0.0, std::ceil(-std::log10(spread))));
    const auto text = fmt::format("{:.{}g}", value, digits);
    const auto rounded = number_in<double>(text).value_or(value);
    const auto inside = std::clamp(rounded, range.low, range.high);
    return inside == rounded ? text : fmt::format("{}", inside);
}

/// 8, 1000 or 1e3, as an integer setting takes it.
bool is_whole(const std::string& text) {
    return text.find('.') == text.npos && if_integer(text).has_value();
}

std::vector<Setting> draw(const SearchSpace& space, std::int64_t sample, int attempt) {
    std::mt19937_64 random(derive_seed(space.seed, fmt::format("sample, attempt {}", attempt), sample));
    std::vector<Setting> settings;
    for (const auto& [key, values, place] : space.settings)
        settings.push_back({key, std::visit([&](const auto& from) { return drawn(from, random); }, values)});
    return settings;
}

}  // namespace

std::optional<NumberRange> number_range(std::string_view text) {
    constexpr std::string_view log = "log ";
    auto ends = text;
    const bool logarithmic = text.starts_with(log);
    if (logarithmic) ends.remove_prefix(log.size());
    const auto dots = ends.find("..");
    if (dots == ends.npos) return std::nullopt;
    std::string low(ends.substr(0, dots)), high(ends.substr(dots + 2));
    for (auto* end : {&low, &high}) std::erase(*end, '_');
    const auto from = number_in<double>(low), to = number_in<double>(high);
    if (!from || !to || !std::isfinite(*from) || !std::isfinite(*to)) return std::nullopt;
    if (high.starts_with('.'))
        throw ConfigError(fmt::format("the range {0} has three dots: write two, {1}..0{2} or {1}..{3}", text,
                                      low, high, high.substr(1)));
    if (*from == *to) throw ConfigError(fmt::format("the range {} has one value: write that alone", text));
    if (*from > *to) throw ConfigError(fmt::format("the range {} is empty: the lower end comes first", text));
    if (logarithmic && *from <= 0)
        throw ConfigError(fmt::format("the range {} has no logarithms: its ends must be above 0", text));
    return NumberRange{
        .low = *from, .high = *to, .logarithmic = logarithmic, .whole = is_whole(low) && is_whole(high)};
}

std::vector<std::vector<Setting>> draw_samples(const SearchSpace& space) {
    std::vector<std::vector<Setting>> samples;
    for (std::int64_t sample = 1; sample <= space.samples; ++sample) {
        auto settings = draw(space, sample, 0);
        for (int attempt = 1; std::ranges::find(samples, settings) != samples.end(); ++attempt) {
            if (attempt > kMostAttempts)
                throw ConfigError(
                    fmt::format("search: no more than {} different samples were found, of {}: let "
                                "samples be fewer, or widen a range",
                                samples.size(), space.samples));
            settings = draw(space, sample, attempt);
        }
        samples.push_back(std::move(settings));
    }
    return samples;
}

}  // namespace cale
