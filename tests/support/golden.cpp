#include "support/golden.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <stdexcept>

namespace golden {

std::string directory() {
    const char* chosen = std::getenv("CALE_GOLDEN_DIR");
    return chosen != nullptr && *chosen != '\0' ? chosen : CALE_SOURCE_GOLDEN_DIR;
}

std::string path_of(const std::string& file_name) {
    for (const std::filesystem::path folder : {directory(), std::string(CALE_SOURCE_GOLDEN_DIR)})
        if (std::filesystem::exists(folder / file_name)) return (folder / file_name).string();
    throw std::runtime_error("no golden file " + directory() + "/" + file_name);
}

YAML::Node load(const std::string& file_name) {
    return YAML::LoadFile(path_of(file_name));
}

namespace {

template <class Chosen>
std::vector<std::string> files_where(const std::string& what, const Chosen& is_chosen) {
    for (const std::string& folder : {directory(), std::string(CALE_SOURCE_GOLDEN_DIR)}) {
        std::vector<std::string> found;
        for (const auto& entry : std::filesystem::directory_iterator(folder)) {
            if (entry.path().extension() != ".yaml") continue;
            const auto file = YAML::LoadFile(entry.path().string());
            if (file.IsMap() && is_chosen(file)) found.push_back(entry.path().filename());
        }
        std::sort(found.begin(), found.end());
        if (!found.empty()) return found;
    }
    throw std::runtime_error("no golden file " + what + " in " + directory());
}

}  // namespace

std::vector<std::string> files_of_kind(std::string_view kind) {
    return files_where("of the kind " + std::string(kind), [kind](const YAML::Node& file) {
        return file["kind"] && file["kind"].as<std::string>() == kind;
    });
}

std::vector<std::string> files_with(std::initializer_list<std::string_view> keys) {
    std::string what = "with";
    for (const auto key : keys) what.append(1, ' ').append(key);
    return files_where(what, [keys](const YAML::Node& file) {
        return std::ranges::all_of(keys, [&file](auto key) { return file[std::string(key)].IsDefined(); });
    });
}

std::uint64_t seed(std::string_view case_name, std::string_view name) {
    std::uint64_t hash = 0xCBF29CE484222325u;
    const auto mix = [&hash](std::string_view text) {
        for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3u;
    };
    mix(case_name);
    mix("/");
    mix(name);
    return hash;
}

std::uint64_t bits(std::uint64_t seed, std::uint64_t index) {
    std::uint64_t z = seed + (index + 1) * 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

double uniform(std::uint64_t seed, std::uint64_t index) {
    return static_cast<double>(bits(seed, index) >> 11) * 0x1.0p-53;
}

}  // namespace golden
