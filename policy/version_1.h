// Policy files of version 1, which described a network by the names of its parts: "encoder", "branch",
// "hidden_layers", ...
#pragma once

#include "policy/network_spec.h"
#include "policy/policy_texts.h"

namespace cale {

/// Removes the texts of a network, all but its number of actions, which is the number of listed actions. The
/// text `encoder` stays: version 2 has it too. Throws FileDamage, naming the first text that is missing or
/// invalid.
NetworkSpec take_network_of_version_1(Texts& texts);

}  // namespace cale
