// Where the joystick is pushed on average.
#pragma once

#include <map>
#include <string>

#include <torch/types.h>

namespace cale {

/// Adds charts/{mean_radius, mean_theta, mean_fire} of an action [3].
void add_mean_action(std::map<std::string, double>& metrics, const torch::Tensor& action);

}  // namespace cale
