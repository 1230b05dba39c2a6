// What of a run's settings may change while it is under way.
#pragma once

#include <array>
#include <string_view>

namespace cale {

/// A resumed run may be made longer, and watched in another way; nothing else may differ.
inline constexpr std::array<std::string_view, 12> kMayDifferOnResume = {"train.total_steps",
                                                                        "train.checkpoint_every",
                                                                        "train.keep_checkpoints",
                                                                        "train.save_replay",
                                                                        "eval.every",
                                                                        "eval.episodes",
                                                                        "eval.noop_max",
                                                                        "eval.video",
                                                                        "log.every",
                                                                        "log.tensorboard",
                                                                        "env.rom_dir",
                                                                        "env.env_threads"};

}  // namespace cale
