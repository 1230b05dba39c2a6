// Gradient steps of every agent that can be repeated, on made-up 84x84 frames and the batch of its
// configuration.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include <c10/core/Device.h>

#include "networks/layers.h"

namespace bench {

/// One gradient step.
using Update = std::function<void()>;

struct Computation {
    cale::Precision precision = cale::Precision::float32;
    c10::Device device = c10::DeviceType::CPU;
};

struct NamedUpdate {
    std::string name;  // such as sac_phi_sac
    std::function<Update(const Computation&)> make;
};

/// Returns the updates of all agents and of all encoders that change their speed.
std::vector<NamedUpdate> updates();

}  // namespace bench
