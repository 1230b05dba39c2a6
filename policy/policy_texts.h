// What a policy is, as the texts of its file's metadata: docs/policy_file.md.
#pragma once

#include <map>
#include <string>
#include <string_view>

#include "policy/network.h"
#include "policy/policy_info.h"

namespace cale {

using Texts = std::map<std::string, std::string>;

/// All but the provenance.
Texts texts_of(const PolicyInfo& info, const PolicyNetwork& network);

/// Takes these texts out of `texts`; what is left is provenance. Throws FileDamage that names the first which
/// is missing, or is not what it must be, and where they do not go together.
void read_texts(Texts& texts, PolicyInfo& info, PolicyNetwork& network);

/// Takes one. Throws FileDamage if it is missing.
std::string take_text(Texts& texts, std::string_view key);

/// A number as short as it can be written without loss.
std::string text_of(double value);

}  // namespace cale
