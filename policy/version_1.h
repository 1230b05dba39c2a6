// Policy files of version 1, which described a network by the names of its parts: "encoder", "branch",
// "hidden_layers", ...
#pragma once

#include "policy/network_spec.h"
#include "policy/policy_texts.h"

namespace cale {

/// Takes the texts of a network, all but its number of actions: that is how many are listed. The text
/// `encoder` stays: version 2 has it too. Throws FileDamage that names the first which is missing, or is not
/// what it must be.
NetworkSpec take_network_of_version_1(Texts& texts);

}  // namespace cale
