// Apart from agent.cpp, so that who reads an agent's losses need not read how a policy is exported.
#include "agents/agent.h"
#include "networks/policy_weights.h"

namespace cale {

AgentPolicy policy_of(const NetworkSpec& acting, const torch::nn::Module& network, bool samples,
                      double epsilon) {
    return {acting, policy_weights(acting, network), samples, epsilon};
}

}  // namespace cale
