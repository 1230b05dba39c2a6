#include "agents/critic.h"

#include "agents/off_policy.h"

namespace cale {

std::span<const std::string_view> names_of(CriticTarget) {
    static constexpr std::string_view names[] = {"target_mean_action", "sampled_action"};
    return names;
}

torch::Tensor CriticSettings::support() const {
    return atoms > 1 ? atom_support(atoms, limit, torch::kFloat32) : torch::Tensor();
}

CriticTargets critic_targets(const TwinValues& outputs, const torch::Tensor& support, TwinEstimate estimate,
                             const torch::Tensor& bonus, const Batch& batch, double reward_scale) {
    const auto q = critic_values(outputs, support);
    CriticTargets targets{.values = n_step_target(batch, q.estimate(estimate) + bonus, reward_scale)};
    if (!support.defined()) return targets;
    const auto p1 = outputs.q1.softmax(1), p2 = outputs.q2.softmax(1);
    const auto next =
        estimate == TwinEstimate::mean ? (p1 + p2) / 2 : torch::where((q.q1 <= q.q2).unsqueeze(1), p1, p2);
    // The entropy's part moves every atom by the same distance.
    const auto returns = n_step_target(batch, support + bonus.unsqueeze(1), reward_scale);  // [B, atoms]
    targets.distribution = project_distribution(returns, next, support);
    return targets;
}

torch::Tensor critic_loss(const TwinValues& outputs, const torch::Tensor& support,
                          const CriticTargets& targets) {
    if (support.defined()) {
        return (cross_entropy(targets.distribution, outputs.q1) +
                cross_entropy(targets.distribution, outputs.q2))
            .mean();
    }
    const auto q = critic_values(outputs, support);
    return ((q.q1 - targets.values).square() + (q.q2 - targets.values).square()).mean();
}

}  // namespace cale
