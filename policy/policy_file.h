// The policy file (docs/policy_file.md): weights and everything that is needed to act with them.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "policy/network_spec.h"
#include "policy/policy_info.h"
#include "policy/stored_tensors.h"

namespace cale {

/// An observation, and the network's output for it: Policy::output.
struct GoldenPair {
    std::vector<std::uint8_t> observation;
    std::vector<float> output;
};

/// The contents of a policy file.
struct PolicyFile {
    PolicyInfo info;
    NetworkSpec network;
    /// The network's parameters: parameter_shapes(network), no more and no less. Every number is finite.
    std::map<std::string, std::vector<float>> weights;
    GoldenPair golden;
};

/// Reads the contents of a file and checks all that can be checked without computing the golden output.
/// Throws FileDamage, one sentence that says what is wrong.
PolicyFile parse_policy_file(std::string_view contents);

/// The contents that parse_policy_file() reads to `policy`. Throws std::invalid_argument for texts that are
/// not UTF-8 and for provenance under a name reserved by the format, std::out_of_range for a missing weight.
std::string policy_file_contents(const PolicyFile& policy);

/// The metadata of those contents, but for the checksum.
std::map<std::string, std::string> policy_file_texts(const PolicyFile& policy);

/// 64 bits over all metadata but the checksum itself and over all tensors, in the order of their names. It
/// detects accidental damage, not tampering.
std::string policy_checksum(const std::map<std::string, std::string>& metadata,
                            const std::map<std::string, StoredTensor>& tensors);

/// A deterministic pseudo-random observation: the upper bytes of x, x' = 1664525 x + 1013904223 modulo 2^32
/// (Knuth's linear congruential generator) from x = 1.
std::vector<std::uint8_t> golden_observation(const PolicyInfo& info);

/// Throws FileDamage unless each number of `output` is the golden one within `tolerance` x max(1, the largest
/// golden number's absolute value).
void check_golden(std::span<const float> output, std::span<const float> golden, double tolerance);
/// That tolerance where the device computes with float32.
inline constexpr double kGoldenTolerance = 1e-3;

}  // namespace cale
