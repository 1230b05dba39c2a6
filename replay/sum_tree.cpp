#include "replay/sum_tree.h"

#include <bit>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

namespace cale {
namespace {

std::int64_t leaves_for(std::int64_t capacity) {
    if (capacity < 1)
        throw std::invalid_argument("a sum tree of " + std::to_string(capacity) + " values; it needs one");
    return static_cast<std::int64_t>(std::bit_ceil(static_cast<std::uint64_t>(capacity)));
}

}  // namespace

SumTree::SumTree(std::int64_t capacity)
    : capacity_(capacity), leaves_(leaves_for(capacity)), nodes_(2 * leaves_) {}

std::int64_t SumTree::bytes(std::int64_t capacity) {
    return 2 * leaves_for(capacity) * std::int64_t{sizeof(double)};
}

void SumTree::set(std::int64_t index, double value) {
    if (!std::isfinite(value) || value < 0) {
        std::ostringstream message;
        message << "value " << index << " of a sum tree is " << value
                << "; it must be finite and not negative";
        throw std::invalid_argument(message.str());
    }
    nodes_[leaf(index)] = value;
    for (std::int64_t node = leaf(index) / 2; node >= 1; node /= 2) restore_sum(node);
}

double SumTree::get(std::int64_t index) const {
    return nodes_[leaf(index)];
}

std::int64_t SumTree::find(double target) const {
    if (!(total() > 0 && target >= 0 && target <= total())) {
        std::ostringstream message;
        message.precision(17);
        message << "no value of a sum tree at " << target << ": its sum is " << total();
        throw std::out_of_range(message.str());
    }
    std::int64_t node = 1;
    while (node < leaves_) {
        node *= 2;
        // Subtractions round: what is left of the target may reach the end of a branch. It
        // never goes where nothing is, so the branch it is in always holds more than 0.
        if (target >= nodes_[node] && nodes_[node + 1] > 0) {
            target -= nodes_[node];
            ++node;
        }
    }
    return node - leaves_;
}

void SumTree::restore_sums() {
    for (std::int64_t node = leaves_ - 1; node >= 1; --node) restore_sum(node);
}

std::int64_t SumTree::leaf(std::int64_t index) const {
    if (index < 0 || index >= capacity_)
        throw std::out_of_range("value " + std::to_string(index) + " of a sum tree of " +
                                std::to_string(capacity_));
    return leaves_ + index;
}

}  // namespace cale
