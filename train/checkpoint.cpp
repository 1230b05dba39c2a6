#include "train/checkpoint.h"

#include <fcntl.h>

#include <algorithm>
#include <cstdio>  // renameat2
#include <iterator>
#include <span>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "replay/replay.h"
#include "storage/files.h"
#include "storage/step_name.h"
#include "terminal/failure.h"
#include "train/agent_file.h"
#include "train/resume.h"
#include "train/safetensors.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr const char* kGamesFile = "games.safetensors";
constexpr const char* kReplayFile = "replay.zst";
constexpr const char* kStateFile = "state.json";
constexpr const char* kEventsFile = "joystick_events.csv";  // the run's, for people and reports
constexpr const char* kPartial = ".partial";
constexpr const char* kDamaged = ".damaged";
constexpr const char* kBest = "best";

constexpr const char* kEvaluation = "evaluation";
constexpr const char* kTraining = "training";

nlohmann::json to_json(const std::optional<Score>& score) {
    if (!score) return nullptr;
    return {{"of", score->evaluated ? kEvaluation : kTraining}, {"mean_return", score->mean_return}};
}

std::optional<Score> score_in(const nlohmann::json& state) {
    const auto found = state.find("score");
    if (found == state.end() || found->is_null()) return std::nullopt;
    return Score{.evaluated = found->at("of") == kEvaluation, .mean_return = found->at("mean_return")};
}

std::string to_json(const RunState& state) {
    return nlohmann::json{{"step", state.step},
                          {"frame", state.frame},
                          {"episodes", state.episodes},
                          {"joystick_events", state.joystick_events},
                          {"reported_events", state.reported_events},
                          {"seconds", state.seconds},
                          {"recent_returns", state.recent_returns},
                          {"episodes_offset", state.episodes_offset},
                          {"progress_rows", state.progress_rows},
                          {"evaluation_due", state.evaluation_due},
                          {"score", to_json(state.score)},
                          {"metrics", state.metrics}}
               .dump(2) +
           "\n";
}

std::int64_t count(const nlohmann::json& json, const char* name) {
    if (json.at(name).is_number_unsigned()) return json.at(name);
    throw std::runtime_error(fmt::format("{}: {} is no count", kStateFile, name));
}

EventCounts event_counts(const nlohmann::json& json) {
    const auto counts = json.get<std::vector<std::int64_t>>();
    EventCounts result{};
    if (counts.size() != result.size() || std::ranges::min(counts) < 0)
        throw std::runtime_error(
            fmt::format("{}: joystick_events are not {} counts", kStateFile, result.size()));
    std::ranges::copy(counts, result.begin());
    return result;
}

RunState from_json(const std::string& text) {
    try {
        const auto json = nlohmann::json::parse(text);
        return {.step = count(json, "step"),
                .frame = count(json, "frame"),
                .episodes = count(json, "episodes"),
                .joystick_events = event_counts(json.at("joystick_events")),
                // Older checkpoints lack them: the next row counts from the start.
                .reported_events = event_counts(json.value("reported_events", nlohmann::json(EventCounts{}))),
                .seconds = json.at("seconds"),
                .recent_returns = json.at("recent_returns"),
                .episodes_offset = count(json, "episodes_offset"),
                .progress_rows = count(json, "progress_rows"),
                .evaluation_due = json.at("evaluation_due"),
                .score = score_in(json),
                .metrics = json.at("metrics")};
    } catch (const nlohmann::json::exception&) {
        throw std::runtime_error(fmt::format("{} is damaged", kStateFile));
    }
}

/// Returns whether the file matches the manifest.
bool is_good(const StoredCheckpoint& checkpoint, const std::string& file) {
    const auto found = checkpoint.manifest.find(file);
    if (found == checkpoint.manifest.end()) return false;
    try {
        return record_of(checkpoint.folder / file) == found->second;
    } catch (const std::system_error&) {
        return false;
    }
}

/// Whether the error is that a file is not there, or is none.
bool is_missing(std::error_code error) {
    return error == std::errc::no_such_file_or_directory || error == std::errc::not_a_directory ||
           error == std::errc::is_a_directory;
}

/// A second name for the same file; a copy where the file system has no such thing.
void link_or_copy(const fs::path& from, const fs::path& to) {
    std::error_code refused;
    fs::create_hard_link(from, to, refused);
    if (refused) write_file_atomically(to, read_file(from));
}

/// A folder's contents that are named in a manifest are never deleted under its name: a run killed meanwhile
/// would leave half of them.
void delete_checkpoint(const fs::path& folder) {
    const fs::path partial = folder.string() + kPartial;
    fs::remove_all(partial);
    fs::rename(folder, partial);
    fs::remove_all(partial);
}

/// Puts `partial` in the place of `folder`, at one stroke where the file system can.
void publish(const fs::path& partial, const fs::path& folder) {
    if (fs::exists(folder) &&
        ::renameat2(AT_FDCWD, partial.c_str(), AT_FDCWD, folder.c_str(), RENAME_EXCHANGE) == 0) {
        fs::remove_all(partial);
    } else if (fs::exists(folder)) {
        const fs::path old = folder.string() + ".old" + kPartial;
        fs::remove_all(old);
        fs::rename(folder, old);
        fs::rename(partial, folder);
        fs::remove_all(old);
    } else {
        fs::rename(partial, folder);
    }
    sync_name(folder);
}

/// Throws UnreadableNow for an error that is not, or may not be, the checkpoint's fault: one that is passed
/// over is deleted.
void require_damage(const std::exception& error, const fs::path& folder) {
    const auto* system = dynamic_cast<const std::system_error*>(&error);
    if (!is_out_of_memory(error) && (system == nullptr || is_missing(system->code()))) return;
    throw UnreadableNow(
        fmt::format("the checkpoint {} cannot be read now: {}; try again, or move it away to resume from the "
                    "one before",
                    folder.string(), failure_sentence(error)));
}

/// What the folder holds, all of it as it was written.
StoredCheckpoint verified(const fs::path& folder) {
    StoredCheckpoint stored{folder, read_manifest(folder)};
    for (const auto& file : {kAgentFile, kGamesFile, kStateFile})
        if (!stored.manifest.contains(file))
            throw std::runtime_error(fmt::format("its manifest.json lacks {}", file));
    verify(folder, stored.manifest);
    return stored;
}

RunState load(const StoredCheckpoint& stored, Agent& agent,
              const std::function<void(const TensorMap&)>& restore_games) {
    const auto& folder = stored.folder;
    auto state = from_json(read_file(folder / kStateFile));
    restore_games(load_safetensors(folder / kGamesFile).tensors);
    agent.load_state(load_agent(folder));
    if (agent.replay() != nullptr && stored.manifest.contains(kReplayFile))
        load_replay(*agent.replay(), folder);
    return state;
}

/// None where it has none, and where its files cannot be read.
std::optional<Score> score_of(const fs::path& folder) {
    try {
        const auto manifest = read_manifest(folder);
        verify(folder, {{kStateFile, manifest.at(kStateFile)}});
        return from_json(read_file(folder / kStateFile)).score;
    } catch (const std::exception&) {
        return std::nullopt;
    }
}

std::optional<fs::path> best_of(std::span<const fs::path> checkpoints) {
    std::optional<fs::path> best;
    std::optional<Score> best_score;
    for (const auto& folder : checkpoints) {
        const auto score = score_of(folder);
        if (score <= best_score) continue;  // none is less than any
        best = folder;
        best_score = score;
    }
    return best;
}

/// Makes the link point to this checkpoint, at one stroke; none: there is no link.
void link_best(const fs::path& link, const std::optional<fs::path>& best) {
    std::error_code ignored;
    if (!best) {
        if (fs::is_symlink(link)) fs::remove(link);
        return;
    }
    if (fs::read_symlink(link, ignored) == best->filename()) return;
    if (fs::is_directory(fs::symlink_status(link)))
        throw std::runtime_error(fmt::format(
            "{} is no link to a checkpoint but a folder, as in a copy that followed links: remove it, then "
            "resume with {}",
            link.string(), resume_options(link.parent_path().parent_path())));
    const fs::path partial = link.string() + kPartial;
    fs::remove(partial);
    fs::create_directory_symlink(best->filename(), partial);
    fs::rename(partial, link);
}

/// Whether it is the first one at or after a multiple of `retention.every`.
bool stays_for_good(const fs::path& folder, const Retention& retention) {
    if (retention.every == 0) return false;
    const auto step = step_in(folder).value_or(0);
    return step >= retention.every && step % retention.every < retention.step_size;
}

}  // namespace

StoredCheckpoint write_checkpoint(const fs::path& run_dir, RunSnapshot snapshot, const StoredCheckpoint* last,
                                  const StoredCheckpoint* before_last) {
    if (!fs::exists(run_dir)) {
        throw std::runtime_error(
            fmt::format("the run's folder {} is gone: no checkpoint could be written", run_dir.string()));
    }
    const fs::path folder = run_dir / "checkpoints" / step_name(snapshot.state.step);
    const fs::path partial = folder.string() + kPartial;
    fs::remove_all(partial);
    fs::create_directories(partial);
    try {
        Manifest manifest;
        if (snapshot.replay) {
            snapshot.replay->save(partial, [&](const std::string& file) {
                if (before_last != nullptr && is_good(*before_last, file)) {
                    link_or_copy(before_last->folder / file, partial / file);
                    manifest[file] = before_last->manifest.at(file);
                } else if (last != nullptr && is_good(*last, file)) {
                    write_file_atomically(partial / file, read_file(last->folder / file));
                } else {
                    return false;
                }
                return true;
            });
            snapshot.replay.reset();
        }
        save_agent(partial, snapshot.agent);
        if (snapshot.policy) write_file_atomically(partial / kPolicyFile, policy_contents(*snapshot.policy));
        save_safetensors(partial / kGamesFile, snapshot.games);
        write_file_atomically(partial / kStateFile, to_json(snapshot.state));
        write_file_atomically(partial / "config.yaml", snapshot.config);
        for (const auto& entry : fs::directory_iterator(partial)) {
            const auto name = entry.path().filename().string();
            if (!manifest.contains(name)) manifest[name] = record_of(entry.path());
        }
        write_manifest(partial, manifest);
        write_file_atomically(run_dir / kEventsFile, event_table(snapshot.state.joystick_events));
        publish(partial, folder);
        return {folder, std::move(manifest)};
    } catch (...) {
        std::error_code ignored;
        fs::remove_all(partial, ignored);
        throw;
    }
}

void delete_other_checkpoints(const fs::path& run_dir, const fs::path& newest, const Retention& retention) {
    const auto all = list_checkpoints(run_dir);
    const auto found = std::ranges::find(all, newest);
    const auto past = found == all.end() ? found : std::next(found);  // somebody may have deleted it
    const auto best = retention.best ? best_of({all.begin(), past}) : std::nullopt;
    link_best(run_dir / "checkpoints" / kBest, best);
    for (auto folder = all.begin(); folder != all.end(); ++folder) {
        const bool stays = folder < past && (past - folder <= retention.newest ||
                                             stays_for_good(*folder, retention) || *folder == best);
        if (!stays) delete_checkpoint(*folder);
    }
    std::vector<fs::path> unfinished;
    for (const auto& entry : fs::directory_iterator(run_dir / "checkpoints"))
        if (entry.path().extension() == kPartial) unfinished.push_back(entry.path());
    for (const auto& folder : unfinished) fs::remove_all(folder);
    for (const auto& folder : named_by_step(run_dir / "checkpoints", kDamaged)) fs::remove_all(folder);
}

std::vector<fs::path> list_checkpoints(const fs::path& run_dir) {
    return named_by_step(run_dir / "checkpoints");  // another name is a user's copy, or unfinished
}

std::vector<fs::path> require_checkpoints(const fs::path& run_dir) {
    auto found = list_checkpoints(run_dir);
    if (!found.empty()) return found;
    std::error_code ignored;
    const auto folder = fs::weakly_canonical(run_dir, ignored);
    for (const auto& above : {folder.parent_path(), folder.parent_path().parent_path()}) {
        if (folder.native().starts_with((above / "checkpoints").native()) && !list_checkpoints(above).empty())
            throw ResumeError(fmt::format("{} is a part of the run {}; give --run-dir that", run_dir.string(),
                                          above.string()));
    }
    if (!fs::exists(run_dir / "config.yaml"))
        throw ResumeError(
            fmt::format("{} holds no run to resume; give --run-dir the folder of one", run_dir.string()));
    const bool may_start = fs::exists(run_dir / "metadata.json") && !has_begun(run_dir);
    throw ResumeError(
        fmt::format("{} holds no checkpoint to resume from; {}", run_dir.string(),
                    may_start ? "start the run again, without --resume" : "give --run-dir another folder"));
}

bool has_begun(const fs::path& run_dir) {
    const auto has_rows = [&](const char* file, std::ptrdiff_t lines_before) {
        const auto path = run_dir / file;
        if (!fs::exists(path)) return false;
        const auto text = read_file(path);
        return std::count(text.begin(), text.end(), '\n') > lines_before;
    };
    return !list_checkpoints(run_dir).empty() || has_rows("episodes.csv", 2) || has_rows("progress.csv", 0);
}

std::optional<StoredCheckpoint> newest_whole_checkpoint(const fs::path& run_dir) {
    const auto all = list_checkpoints(run_dir);
    for (auto folder = all.rbegin(); folder != all.rend(); ++folder) {
        try {
            return verified(*folder);
        } catch (const std::exception& error) {
            require_damage(error, *folder);
        }
    }
    return std::nullopt;
}

void set_aside_damaged(const fs::path& run_dir, const fs::path& resumed) {
    const auto all = list_checkpoints(run_dir);
    const auto found = std::ranges::find(all, resumed);
    if (found == all.end()) return;
    for (const auto& folder : std::span(std::next(found), all.end())) {
        const fs::path aside = folder.string() + kDamaged;
        fs::remove_all(aside);
        fs::rename(folder, aside);
    }
}

Checkpoint load_newest_checkpoint(const fs::path& run_dir, Agent& agent,
                                  const std::function<void(const TensorMap&)>& restore_games) {
    const auto all = require_checkpoints(run_dir);
    Checkpoint checkpoint;
    for (auto folder = all.rbegin(); folder != all.rend(); ++folder) {
        bool is_whole = false;
        try {
            checkpoint.stored = verified(*folder);
            is_whole = true;
            checkpoint.state = load(checkpoint.stored, agent, restore_games);
            return checkpoint;
        } catch (const std::exception& error) {
            require_damage(error, *folder);
            const auto why = failure_sentence(error);
            if (is_whole || dynamic_cast<const OtherFormat*>(&error) != nullptr)
                throw DoesNotFit(fmt::format("the checkpoint {} is not damaged, but does not fit: {}",
                                             folder->string(), why),
                                 "undo what has changed since it was written, or move it away to resume from "
                                 "the one before");
            checkpoint.passed_over.push_back(
                fmt::format("The checkpoint {} cannot be read: {}", folder->string(), why));
        }
    }
    throw ResumeError(
        fmt::format("no checkpoint of {} can be read: restore one, or start a new run; of the newest: {}",
                    run_dir.string(), checkpoint.passed_over.front()));
}

}  // namespace cale
