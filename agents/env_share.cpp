#include "agents/env_share.h"

#include <array>
#include <stdexcept>
#include <string>

#include <torch/types.h>

#include "parallel/process_group.h"

namespace cale {
namespace {

/// [T, N, ...]
constexpr std::array kByStepAndEnv{"observation", "action", "reward", "terminal"};
/// [cuts, 2] step and environment, and what was cut off there.
constexpr const char* kCutAt = "truncation_at";
constexpr const char* kCutObservation = "truncation_observation";

const torch::Tensor& part(const TensorMap& state, const std::string& name, std::int64_t dimensions) {
    const auto found = state.find(name);
    if (found != state.end() && found->second.dim() >= dimensions) return found->second;
    throw std::runtime_error("a stored rollout lacks 'rollout/" + name + "'");
}

}  // namespace

EnvShare::EnvShare(const AgentSpec& spec) : count(spec.num_envs), all(spec.num_envs) {
    if (spec.processes == nullptr) return;
    first = count * spec.processes->rank();
    all = count * spec.processes->size();
}

torch::Tensor EnvShare::own(const torch::Tensor& global) const {
    return global.slice(0, first, first + count);
}

torch::Tensor EnvShare::among_all(const torch::Tensor& own, double filler) const {
    if (count == all) return own;
    auto shape = own.sizes().vec();
    shape.front() = all;
    auto result = torch::full(shape, filler, own.options());
    result.slice(0, first, first + count).copy_(own);
    return result;
}

torch::Tensor EnvShare::own_rows(const torch::Tensor& rows) const {
    if (count == all) return rows;
    const auto step = rows.div(all, "floor");
    const auto env = rows - step * all - first;
    return (step * count + env).masked_select((env >= 0) & (env < count));
}

TensorMap joined_rollouts(const std::vector<TensorMap>& shares) {
    if (shares.empty()) return {};
    if (shares.size() == 1) return shares.front();
    TensorMap whole;
    for (const auto* name : kByStepAndEnv) {
        std::vector<torch::Tensor> columns;
        columns.reserve(shares.size());
        for (const auto& share : shares) columns.push_back(part(share, name, 2));
        whole[name] = torch::cat(columns, 1);
    }
    std::vector<torch::Tensor> cut_at, cut_observations;
    std::int64_t first = 0;
    for (const auto& share : shares) {
        cut_at.push_back(part(share, kCutAt, 2) + torch::tensor({std::int64_t{0}, first}));
        cut_observations.push_back(part(share, kCutObservation, 1));
        first += part(share, "reward", 2).size(1);
    }
    whole[kCutAt] = torch::cat(cut_at);
    whole[kCutObservation] = torch::cat(cut_observations);
    return whole;
}

TensorMap share_of_rollout(const TensorMap& whole, const EnvShare& share) {
    if (share.count == share.all) return whole;
    const auto end = share.first + share.count;
    TensorMap found;
    for (const auto* name : kByStepAndEnv) {
        const auto& global = part(whole, name, 2);
        if (global.size(1) != share.all)
            throw std::runtime_error("a stored rollout is of " + std::to_string(global.size(1)) +
                                     " environments, not of " + std::to_string(share.all));
        found[name] = global.slice(1, share.first, end).clone();
    }
    const auto& cut_at = part(whole, kCutAt, 2);
    const auto env = cut_at.select(1, 1);
    const auto own = ((env >= share.first) & (env < end)).nonzero().squeeze(1);
    found[kCutAt] = cut_at.index_select(0, own) - torch::tensor({std::int64_t{0}, share.first});
    found[kCutObservation] = part(whole, kCutObservation, 1).index_select(0, own);
    return found;
}

}  // namespace cale
