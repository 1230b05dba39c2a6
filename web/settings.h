// The environment of a game in the page: that in which the policy was trained, but for what the visitor
// changes.
#pragma once

#include <string>
#include <string_view>

#include "cale/env.h"
#include "policy/policy_info.h"

namespace cale::web {

/// Returns the environment that the policy was trained in, from the `env` section of its run's configuration.
/// Throws std::runtime_error where it holds none, or a setting that this page does not know.
EnvConfig trained_env(const PolicyInfo& info);

/// Changes settings, a line "threshold=0.5" each, by their names in fields(EnvConfig). Throws
/// std::invalid_argument for an unknown one, and as read_setting() does.
void change(EnvConfig& env, std::string_view lines);

/// Returns the value of a setting as change() reads it, such as "0-8" of action_latency. Throws
/// std::invalid_argument for an unknown name.
std::string setting(EnvConfig env, std::string_view name);

}  // namespace cale::web
