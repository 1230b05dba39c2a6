// A policy's description as the texts of its file's metadata: docs/policy_file.md.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "policy/network_spec.h"
#include "policy/policy_info.h"

namespace cale {

using Texts = std::map<std::string, std::string>;

/// All but the provenance.
Texts texts_of(const PolicyInfo& info, const NetworkSpec& network);

/// Removes all but the provenance from `texts`. Those of version 1 describe the network by names
/// (policy/version_1.h). Throws FileDamage, naming the first text that is missing or invalid, and for texts
/// that contradict each other.
void read_texts(Texts& texts, bool version_1, PolicyInfo& info, NetworkSpec& network);

// Each removes one text. Throws FileDamage if it is missing or, except for take_text(), invalid.
std::string take_text(Texts& texts, std::string_view key);
std::string take_choice(Texts& texts, std::string_view key, std::span<const std::string_view> allowed);
bool take_truth(Texts& texts, std::string_view key);
std::int64_t take_whole(Texts& texts, std::string_view key, std::int64_t low, std::int64_t high);
double take_real(Texts& texts, std::string_view key, double low, double high);

}  // namespace cale
