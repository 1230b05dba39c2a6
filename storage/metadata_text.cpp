#include "storage/metadata_text.h"

#include <nlohmann/json.hpp>

#include "storage/files.h"

namespace cale {

std::string metadata_text(const std::filesystem::path& run_dir, const char* key) {
    const auto file = run_dir / "metadata.json";
    if (!std::filesystem::exists(file)) return "";
    const auto metadata = nlohmann::json::parse(read_file(file), nullptr, /*allow_exceptions=*/false);
    if (!metadata.is_object() || !metadata.contains(key) || !metadata[key].is_string()) return "";
    return metadata[key].get<std::string>();
}

}  // namespace cale
