#include "agents/c51.h"

namespace cale {

torch::Tensor atom_support(std::int64_t num_atoms, double limit, const torch::TensorOptions& options) {
    return torch::linspace(-limit, limit, num_atoms, options);
}

torch::Tensor project_distribution(const torch::Tensor& returns, const torch::Tensor& probabilities,
                                   const torch::Tensor& support) {
    const auto spacing = (support[-1] - support[0]) / (support.size(0) - 1);
    const auto clipped = returns.clamp(support[0], support[-1]).unsqueeze(1);  // [B, 1, atoms]
    // An atom takes from each return what is closer to it than one spacing. In place, as with many atoms this
    // is the largest tensor of an update.
    auto share = clipped - support.unsqueeze(1);  // [B, to, from]
    share.abs_().div_(-spacing).add_(1).clamp_(0, 1).mul_(probabilities.unsqueeze(1));
    return share.sum(2);
}

torch::Tensor cross_entropy(const torch::Tensor& target, const torch::Tensor& logits) {
    return -(target * logits.log_softmax(1)).sum(1);
}

}  // namespace cale
