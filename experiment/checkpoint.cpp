#include "experiment/checkpoint.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "experiment/files.h"
#include "experiment/safetensors.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr int kFormatVersion = 2;
constexpr const char* kAgentFile = "agent.safetensors";
constexpr const char* kGamesFile = "games.safetensors";
constexpr const char* kReplayFile = "replay.zst";
constexpr const char* kStateFile = "state.json";

std::string to_json(const RunState& state, bool has_replay) {
    return nlohmann::json{{"format_version", kFormatVersion},
                          {"has_replay", has_replay},
                          {"step", state.step},
                          {"frame", state.frame},
                          {"episodes", state.episodes},
                          {"seconds", state.seconds},
                          {"recent_returns", state.recent_returns},
                          {"episodes_offset", state.episodes_offset},
                          {"progress_rows", state.progress_rows},
                          {"metrics", state.metrics}}
        .dump(2);
}

RunState from_json(const nlohmann::json& json) {
    return {.step = json.at("step"),
            .frame = json.at("frame"),
            .episodes = json.at("episodes"),
            .seconds = json.at("seconds"),
            .recent_returns = json.at("recent_returns"),
            .episodes_offset = json.at("episodes_offset"),
            .progress_rows = json.at("progress_rows"),
            .metrics = json.at("metrics")};
}

Checkpoint load_checkpoint(const fs::path& folder, Agent& agent, bool load_replay) {
    std::ifstream file(folder / kStateFile);
    if (!file) throw std::runtime_error(fmt::format("{} is missing", kStateFile));
    const auto json = nlohmann::json::parse(file);
    if (json.at("format_version") != kFormatVersion) {
        throw std::runtime_error(fmt::format("its format is version {}, this program reads version {}",
                                             json.at("format_version").dump(), kFormatVersion));
    }
    Checkpoint checkpoint{.state = from_json(json), .games = load_safetensors(folder / kGamesFile).tensors};
    agent.load_state(load_safetensors(folder / kAgentFile).tensors);
    if (load_replay && json.at("has_replay")) agent.load_memory((folder / kReplayFile).string());
    return checkpoint;
}

}  // namespace

fs::path save_checkpoint(const fs::path& run_dir, Agent& agent, const TensorMap& games, const RunState& state,
                         bool save_replay, std::int64_t keep) {
    fs::path folder = run_dir / "checkpoints" / fmt::format("step_{:09}", state.step);
    const fs::path partial = folder.string() + ".partial";
    fs::remove_all(partial);
    fs::create_directories(partial);
    try {
        save_safetensors(partial / kAgentFile, agent.state());
        save_safetensors(partial / kGamesFile, games);
        if (save_replay) agent.save_memory((partial / kReplayFile).string());
        write_file_atomically(partial / kStateFile, to_json(state, save_replay));
        fs::remove_all(folder);
        fs::rename(partial, folder);
        sync_name(folder);
    } catch (...) {
        std::error_code ignored;
        fs::remove_all(partial, ignored);
        throw;
    }
    const auto all = list_checkpoints(run_dir);
    for (std::size_t i = 0; i + static_cast<std::size_t>(keep) < all.size(); ++i) fs::remove_all(all[i]);
    return folder;
}

std::vector<fs::path> list_checkpoints(const fs::path& run_dir) {
    std::vector<fs::path> found;
    const fs::path folder = run_dir / "checkpoints";
    if (!fs::is_directory(folder)) return found;
    for (const auto& entry : fs::directory_iterator(folder)) {
        const std::string name = entry.path().filename().string();
        if (name.starts_with("step_") && !name.ends_with(".partial")) found.push_back(entry.path());
    }
    // By length first: a run of more than 999,999,999 steps has longer names.
    std::sort(found.begin(), found.end(), [](const fs::path& a, const fs::path& b) {
        return std::pair(a.string().size(), a.string()) < std::pair(b.string().size(), b.string());
    });
    return found;
}

Checkpoint load_newest_checkpoint(const fs::path& run_dir, Agent& agent, bool load_replay) {
    const auto all = list_checkpoints(run_dir);
    if (all.empty()) {
        throw ResumeError(
            fmt::format("{} holds no checkpoint to resume from; give --run-dir the folder of a run, or leave "
                        "--resume out",
                        run_dir.string()));
    }
    std::vector<std::string> passed_over;
    for (auto folder = all.rbegin(); folder != all.rend(); ++folder) {
        try {
            auto checkpoint = load_checkpoint(*folder, agent, load_replay);
            checkpoint.passed_over = std::move(passed_over);
            return checkpoint;
        } catch (const std::exception& error) {
            passed_over.push_back(
                fmt::format("The checkpoint {} cannot be read: {}.", folder->string(), error.what()));
        }
    }
    throw ResumeError(fmt::format("no checkpoint of {} can be read; of the newest: {}", run_dir.string(),
                                  passed_over.front()));
}

}  // namespace cale
