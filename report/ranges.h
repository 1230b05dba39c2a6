// Ranges as vectors and as text.
#pragma once

#include <functional>
#include <iterator>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace cale {

/// Returns f of each element; `f` may point to a member.
template <class Range, class F>
auto mapped(Range&& range, F&& f) {
    std::vector<std::decay_t<std::invoke_result_t<F&, decltype(*std::begin(range))>>> results;
    results.reserve(std::size(range));
    for (auto&& element : range) results.push_back(std::invoke(f, element));
    return results;
}

/// Returns the values of a map, in the order of its keys.
template <class Map>
auto values_in(Map map) {
    return mapped(map, [](auto& entry) { return std::move(entry.second); });
}

/// Returns the elements as text.
template <class Range>
std::string joined(const Range& range, std::string_view separator) {
    return fmt::format("{}", fmt::join(range, separator));
}

}  // namespace cale
