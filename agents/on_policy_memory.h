// The memory that an on-policy agent needs, computed before it is constructed.
#pragma once

#include <cstdint>

#include "agents/agent.h"
#include "agents/on_policy.h"

namespace cale {

/// See agents/agent.h. Names what is too large and the settings to lower.
void check_memory(const OnPolicySettings& settings, const AgentSpec& spec, std::int64_t available);

}  // namespace cale
