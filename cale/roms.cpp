#include <cstdlib>
#include <stdexcept>
#include <system_error>
#include <vector>

#include "cale/env.h"
#include "cale/games.h"

namespace cale {
namespace {

std::filesystem::path from_environment(const char* name) {
    const char* value = std::getenv(name);
    return value == nullptr ? "" : value;
}

// Where scripts/setup puts what it installs.
std::filesystem::path deps_dir() {
    if (auto deps = from_environment("CALE_DEPS_DIR"); !deps.empty()) return deps;
    if (const auto cache = from_environment("XDG_CACHE_HOME"); !cache.empty()) return cache / "cale";
    return from_environment("HOME") / ".cache" / "cale";
}

}  // namespace

std::filesystem::path find_rom(std::string_view game, const std::string& rom_dir) {
    const std::string file = std::string(find_game(game).rom) + ".bin";
    // A folder that a setting names is the only one that is meant.
    std::vector<std::filesystem::path> folders = {rom_dir};
    if (rom_dir.empty()) folders = {from_environment("ALE_ROMS_DIR"), deps_dir() / "roms"};
    std::string searched;
    for (const auto& folder : folders) {
        if (folder.empty()) continue;
        std::error_code unreadable;  // such a folder does not have it
        if (std::filesystem::is_regular_file(folder / file, unreadable)) return folder / file;
        searched += (searched.empty() ? "" : ", ") + folder.string();
    }
    throw std::runtime_error("the ROM file " + file + " is not in " + searched +
                             (rom_dir.empty()
                                  ? ": run scripts/setup, or let env.rom_dir or ALE_ROMS_DIR name a "
                                    "folder that has it"
                                  : ": let env.rom_dir name a folder that has it, or leave it out, and "
                                    "ALE_ROMS_DIR and the folder of scripts/setup are searched"));
}

std::vector<std::filesystem::path> find_roms(const EnvConfig& config) {
    std::vector<std::filesystem::path> roms;
    for (const auto* const game : games_of(config.game)) roms.push_back(find_rom(game->rom, config.rom_dir));
    return roms;
}

}  // namespace cale
