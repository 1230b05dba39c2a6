#include "storage/metadata_text.h"

#include <nlohmann/json.hpp>

#include "storage/files.h"

namespace cale {

namespace {

/// The value under `key`; null where there is none, or the file is damaged.
nlohmann::json metadata_value(const std::filesystem::path& run_dir, const char* key) {
    const auto file = run_dir / "metadata.json";
    if (!std::filesystem::exists(file)) return nullptr;
    const auto metadata = nlohmann::json::parse(read_file(file), nullptr, /*allow_exceptions=*/false);
    return metadata.is_object() && metadata.contains(key) ? metadata[key] : nlohmann::json();
}

}  // namespace

std::string metadata_text(const std::filesystem::path& run_dir, const char* key) {
    const auto value = metadata_value(run_dir, key);
    return value.is_string() ? value.get<std::string>() : "";
}

bool metadata_say_unfinished(const std::filesystem::path& run_dir) {
    return metadata_value(run_dir, "finished") == false;
}

}  // namespace cale
