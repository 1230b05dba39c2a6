#include "policy/factor_means.h"

#include <functional>
#include <numeric>

namespace cale {

std::vector<float> factor_means(const std::vector<std::int64_t>& factors) {
    const auto actions = std::reduce(factors.begin(), factors.end(), std::int64_t{1}, std::multiplies());
    std::vector<float> means;
    for (std::int64_t action = 0; action < actions; ++action) {
        auto every = actions;  // so many actions share a choice, or a cycle of them
        for (const auto factor : factors) {
            every /= factor;
            for (std::int64_t choice = 0; choice < factor; ++choice)
                means.push_back(action / every % factor == choice ? 1 / static_cast<float>(factors.size())
                                                                  : 0);
        }
    }
    return means;
}

}  // namespace cale
