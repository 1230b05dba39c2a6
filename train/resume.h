// What is to be known of a run before it is resumed: how far it came, and which of its settings may change.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace cale {

/// A resumed run may be made longer, unless a schedule lasts for the whole run, and watched in another way;
/// nothing else may differ.
inline constexpr std::array<std::string_view, 14> kMayDifferOnResume = {"train.total_steps",
                                                                        "train.checkpoint_every",
                                                                        "train.keep_checkpoints",
                                                                        "train.keep_every",
                                                                        "train.keep_best",
                                                                        "train.save_replay",
                                                                        "eval.every",
                                                                        "eval.episodes",
                                                                        "eval.noop_max",
                                                                        "eval.video",
                                                                        "log.every",
                                                                        "log.tensorboard",
                                                                        "env.rom_dir",
                                                                        "env.env_threads"};

/// The step of a checkpoint: 250000 of a folder named step_000250000. None for another name.
std::optional<std::int64_t> checkpoint_step(const std::filesystem::path& folder);
/// "agent.gamma was 0.99 and is now 0.5"; empty where the setting may differ. `schedule_over_run`: the key of
/// the setting by which a schedule lasts for the whole run, so that its length is no free choice; empty:
/// there is none.
std::string change_of_run(std::string_view key, std::string_view before, std::string_view now,
                          std::string_view schedule_over_run);

/// The largest step that a name in the folder has: step_000250000 and then `ending`. None where there is no
/// such name, or no folder.
std::optional<std::int64_t> newest_step(const std::filesystem::path& folder, std::string_view ending);

}  // namespace cale
