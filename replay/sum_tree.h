// Finds the value into which a point on the cumulative sum falls: the sum tree of prioritised replay (Schaul
// et al. 2016, appendix B.2.1).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace cale {

/// `capacity` values, all 0 at first, as the leaves of a binary tree whose inner nodes are
/// the sums of their two children: set() and find() take O(log capacity). A sum depends on
/// the values only, not on the order in which they were set.
class SumTree {
  public:
    /// Throws std::invalid_argument unless capacity is positive.
    explicit SumTree(std::int64_t capacity);
    /// The memory that a tree of this capacity takes.
    static std::int64_t bytes(std::int64_t capacity);

    /// Throws std::invalid_argument, naming the value, unless it is finite and not negative;
    /// std::out_of_range for the index.
    void set(std::int64_t index, double value);
    /// Throws std::out_of_range.
    double get(std::int64_t index) const;
    /// The sum of all values.
    double total() const { return nodes_[1]; }

    /// The first index i with target < value 0 + ... + value i, up to rounding; its value is
    /// never 0. A target that was rounded up to total() finds the last value above 0.
    /// Throws std::out_of_range for a target outside [0, total()], and if total() is 0.
    std::int64_t find(double target) const;

    /// All values in order, for saving and restoring. After writing, restore_sums() must be called.
    std::span<double> values() { return {nodes_.data() + leaves_, static_cast<std::size_t>(capacity_)}; }
    /// The same, to be read.
    std::span<const double> values() const {
        return {nodes_.data() + leaves_, static_cast<std::size_t>(capacity_)};
    }
    /// Computes all sums from the values.
    void restore_sums();

  private:
    std::int64_t leaf(std::int64_t index) const;  // its node; throws std::out_of_range
    void restore_sum(std::int64_t index) {
        const auto node = static_cast<std::size_t>(index);
        nodes_[node] = nodes_[2 * node] + nodes_[2 * node + 1];
    }

    std::int64_t capacity_, leaves_;  // leaves_: the power of two that is at least capacity_
    std::vector<double> nodes_;  // [2 * leaves_] 1: the root; 2i and 2i + 1: the children of i; leaves last
};

}  // namespace cale
