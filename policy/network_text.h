// A network's specification as the text `network` of a policy file: docs/policy_file.md.
#pragma once

#include <string>
#include <string_view>

#include "policy/network_spec.h"

namespace cale {

/// Returns "observation 4 84 84; conv encoder.conv1 32 3 2 same; relu; ...; squashed_gaussian".
std::string network_text(const NetworkSpec& network);

/// Reads what network_text() wrote. Throws FileDamage, one sentence, for any other text, for layers that do
/// not fit together, and for a network that exceeds the limits on memory and time: 2^26 numbers in all layers
/// for one observation, 2^34 multiplications and comparisons in its convolutions and poolings.
NetworkSpec parse_network(std::string_view text);

/// Throws FileDamage as parse_network() does for layers that do not fit together or are too large.
void check_network(const NetworkSpec& network);

/// A number as short as it can be written without loss.
std::string number_text(double value);

}  // namespace cale
