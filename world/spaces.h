// What an agent may do and what it sees, as values.
#pragma once

#include <cstdint>
#include <numbers>
#include <string>
#include <variant>
#include <vector>

namespace cale {

/// `n` actions, numbered from 0.
struct Discrete {
    std::int64_t n = 0;  // at least 1
    /// Where an action is one choice out of each of several sets, the sizes of the sets: their product is n,
    /// and the last choice varies fastest. Empty: an action has no parts.
    std::vector<std::int64_t> factors = {};
    bool operator==(const Discrete&) const = default;
};

/// Vectors of real numbers: coordinate i lies in [low[i], high[i]]. Agents need finite limits, low < high.
struct Box {
    std::vector<float> low, high;         // of one size
    std::vector<std::string> names = {};  // of the coordinates, for logs; empty: axis_0, axis_1, ...
    /// One action for each event that the world tells apart, coordinate by coordinate: random play may choose
    /// among them. Empty: there are none.
    std::vector<float> landmarks = {};
    /// Returns the number of coordinates.
    std::int64_t size() const { return static_cast<std::int64_t>(low.size()); }
    bool operator==(const Box&) const = default;
};

/// Returns the box of CALE's joystick: (r, theta, fire) in [0, 1] x [-pi, pi] x [0, 1].
inline Box joystick_space() {
    constexpr auto kPi = std::numbers::pi_v<float>;
    return {.low = {0, -kPi, 0}, .high = {1, kPi, 1}, .names = {"radius", "theta", "fire"}};
}

/// What a step takes: the number of an action, or a vector.
using ActionSpace = std::variant<Discrete, Box>;

/// Returns the number of actions of a discrete space; 0 for a box.
inline std::int64_t num_actions(const ActionSpace& space) {
    const auto* discrete = std::get_if<Discrete>(&space);
    return discrete != nullptr ? discrete->n : 0;
}

/// Returns the number of coordinates of a box; 0 for a discrete space.
inline std::int64_t box_size(const ActionSpace& space) {
    const auto* box = std::get_if<Box>(&space);
    return box != nullptr ? box->size() : 0;
}

/// The newest `stack` arrays of bytes, newest last: frames {height, width}, or {128} bytes of a console.
struct ObservationSpace {
    std::int64_t stack = 4;                   // arrays of an observation
    std::vector<std::int64_t> shape{84, 84};  // of one array
    /// Returns the number of bytes of one array.
    std::int64_t frame_size() const {
        std::int64_t size = 1;
        for (const auto extent : shape) size *= extent;
        return size;
    }
    /// Returns the shape of observations in a tensor: the sizes `before`, the stack, then those of an array.
    std::vector<std::int64_t> tensor_shape(std::vector<std::int64_t> before = {}) const {
        before.push_back(stack);
        before.insert(before.end(), shape.begin(), shape.end());
        return before;
    }
    bool operator==(const ObservationSpace&) const = default;
};

}  // namespace cale
