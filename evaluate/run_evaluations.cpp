#include "evaluate/run_evaluations.h"

#include <algorithm>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cale/text.h"
#include "report/csv.h"
#include "storage/checksum.h"
#include "storage/files.h"
#include "storage/step_name.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr const char* kProtocol = "protocol.json";

void collect(const fs::path& folder, std::vector<fs::path>& runs) {
    for (const auto& entry : fs::directory_iterator(folder, fs::directory_options::skip_permission_denied)) {
        std::error_code lost;  // of a link that leads nowhere
        if (!entry.is_directory(lost)) continue;
        if (is_run(entry.path())) {
            runs.push_back(entry.path());
        } else if (!entry.is_symlink()) {
            collect(entry.path(), runs);
        }
    }
}

std::string json_of(const EvaluationProtocol& protocol) {
    const auto limit = [](std::int64_t number) {
        return number == kNoLimit ? nlohmann::ordered_json() : nlohmann::ordered_json(number);
    };
    const auto noop_max = protocol.noop_max ? nlohmann::ordered_json(*protocol.noop_max) : nullptr;
    return nlohmann::ordered_json{{"protocol", protocol.name},      {"games", limit(protocol.games)},
                                  {"steps", limit(protocol.steps)}, {"epsilon", protocol.epsilon},
                                  {"noop_max", noop_max},           {"seed", protocol.seed},
                                  {"choice", protocol.choice},      {"settings", protocol.settings}}
               .dump(2) +
           "\n";
}

std::string line_of(std::int64_t number, const EvaluatedGame& game) {
    nlohmann::ordered_json rewards = nlohmann::ordered_json::array();
    for (const auto& [reward, count] : game.rewards) rewards.push_back({reward, count});
    return nlohmann::ordered_json{{"game", number},        {"return", game.episode_return},
                                  {"length", game.length}, {"frames", game.frames},
                                  {"events", game.events}, {"rewards", rewards}}
               .dump() +
           "\n";
}

/// Throws nlohmann::json::exception for another text.
std::pair<std::int64_t, EvaluatedGame> game_of(std::string_view line) {
    const auto json = nlohmann::json::parse(line);
    EvaluatedGame game{.episode_return = json.at("return"),
                       .length = json.at("length"),
                       .frames = json.at("frames"),
                       .events = json.at("events")};
    for (const auto& reward : json.at("rewards")) game.rewards[reward.at(0).get<float>()] = reward.at(1);
    return {json.at("game").get<std::int64_t>(), game};
}

}  // namespace

bool is_run(const fs::path& folder) {
    std::error_code ignored;
    return fs::exists(folder / "config.yaml", ignored) &&
           (fs::exists(folder / "episodes.csv", ignored) || fs::exists(folder / "checkpoints", ignored));
}

std::vector<fs::path> run_folders(const fs::path& folder) {
    std::vector<fs::path> runs;
    collect(folder, runs);
    std::ranges::sort(runs, natural_less,
                      [](const fs::path& run) -> std::string_view { return run.native(); });
    return runs;
}

fs::path evaluations_folder(const fs::path& run, const EvaluationProtocol& protocol) {
    return run / "evaluations" /
           fmt::format("{}-{}", protocol.name, checksum_text(crc32c(json_of(protocol))));
}

void make_evaluations_folder(const fs::path& folder, const EvaluationProtocol& protocol) {
    const auto file = folder / kProtocol;
    const auto text = json_of(protocol);
    if (!fs::exists(file)) {
        fs::create_directories(folder);
        write_file_atomically(file, text);
    } else if (read_file(file) != text) {
        throw std::runtime_error(
            fmt::format("{} is not what its folder is named after: it was changed, or is damaged; move the "
                        "folder away, and its games are played again",
                        file.string()));
    }
}

std::optional<EvaluationResult> evaluation_result(const fs::path& folder, std::int64_t agent_steps,
                                                  std::string_view policy) {
    const auto name = step_name(agent_steps);
    try {
        const auto json = nlohmann::json::parse(read_file(folder / (name + ".json")));
        if (!policy.empty() && json.at("policy_crc32c") != policy) return std::nullopt;
        EvaluationResult result{.agent_steps = agent_steps,
                                .games = json.at("games"),
                                .mean = json.at("mean"),
                                .standard_deviation = json.at("standard_deviation"),
                                .median = json.at("median")};
        if (json.at("human_normalised").is_number()) result.human_normalised = json.at("human_normalised");
        const auto played = read_whole_csv(folder / (name + ".csv"));
        return std::ssize(played.rows) == result.games ? std::optional(result) : std::nullopt;
    } catch (const std::exception&) {
        return std::nullopt;  // missing, damaged, or of a version without checksums: it is played again
    }
}

fs::path partial_evaluation(const fs::path& folder, std::int64_t agent_steps, std::string_view policy) {
    return folder / fmt::format("{}-{}.partial", step_name(agent_steps), policy);
}

PlayedGames::PlayedGames(const fs::path& file)
    : file_([&] {
          if (!fs::exists(file)) return AppendFile(file);
          const std::string text = read_file(file);
          std::size_t good = 0;
          try {
              for (auto end = text.find('\n'); end != text.npos; end = text.find('\n', good)) {
                  known_.insert(game_of(std::string_view(text).substr(good, end - good)));
                  good = end + 1;
              }
          } catch (const nlohmann::json::exception&) {
              // Damaged: this game and those after it are played again.
          }
          return AppendFile(file, static_cast<std::int64_t>(good));
      }()) {}

void PlayedGames::write(std::int64_t number, const EvaluatedGame& game) {
    file_.write(line_of(number, game));
}

std::string evaluation_table(const std::vector<EvaluationRow>& rows) {
    std::size_t widest = 3;
    for (const auto& row : rows) widest = std::max(widest, printable(row.run).size());
    std::string text = fmt::format("{:<{}}  {:>11}  {:>5}  {:>10}  {:>9}  {:>10}  {:>16}\n", "run", widest,
                                   "agent steps", "games", "mean", "std", "median", "human-normalised");
    for (const auto& [run, result, failure] : rows) {
        text += fmt::format("{:<{}}  ", printable(run), widest);
        if (!result) {
            text += fmt::format("none: {}\n", failure);
            continue;
        }
        text +=
            fmt::format("{:>11}  {:>5}  {:>10.2f}  {:>9.2f}  {:>10.2f}  {:>16}\n", result->agent_steps,
                        result->games, result->mean, result->standard_deviation, result->median,
                        result->human_normalised ? fmt::format("{:.4f}", *result->human_normalised) : "-");
    }
    return text;
}

}  // namespace cale
