#include "evaluate/evaluation_report.h"

#include <algorithm>
#include <array>
#include <numeric>

#include <ATen/Parallel.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cale/fields.h"
#include "cale/games.h"
#include "cale/random_play.h"
#include "cale/text.h"
#include "settings/config.h"
#include "settings/versions.h"
#include "storage/files.h"

namespace cale {
namespace {

std::string provenance(const PolicyInfo& policy, const std::string& name) {
    const auto found = policy.provenance.find(name);
    return found == policy.provenance.end() ? "" : found->second;
}

/// "NOOP 61.2%, FIRE 20.1%, ...": the commonest first, those that never happened left out.
std::string event_shares(const EventCounts& events) {
    std::array<std::size_t, kEventCount> order{};
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, std::greater(), [&](std::size_t event) { return events[event]; });
    const auto all = std::accumulate(events.begin(), events.end(), std::int64_t{0});
    std::string text;
    for (const std::size_t event : order) {
        if (events[event] == 0) break;
        text += fmt::format("{}{} {:.1f}%", text.empty() ? "" : ", ", event_name(static_cast<Event>(event)),
                            100.0 * static_cast<double>(events[event]) / static_cast<double>(all));
    }
    return text;
}

/// What a policy that has learned nothing returns in this environment, and how that is known.
std::string random_play(const EnvConfig& env) {
    if (const auto play = joystick_random(env)) {
        return fmt::format("{:.2f} ({:.2f} to {:.2f}), measured with the joystick", play->mean, play->low,
                           play->high);
    }
    if (const auto published = random_floor(env)) return fmt::format("{:.2f}, published", *published);
    return find_game(env.game).random_score ? "not known with these actions and rules"
                                            : "there is no random score of this game";
}

/// "100", or "3 of 100 (none begins after 2000 agent steps)".
std::string games_text(const EvaluationPlan& plan, const Evaluation& evaluation) {
    const auto played = std::ssize(evaluation.games);
    if (evaluation.interrupted && plan.games != kNoLimit)
        return fmt::format("{} of {}, as it was interrupted", played, plan.games);
    if (evaluation.interrupted) return fmt::format("{}, as it was interrupted", played);
    if (played >= plan.games || plan.games == kNoLimit) return fmt::format("{}", played);
    return fmt::format("{} of {} (none begins after {} agent steps)", played, plan.games, plan.steps);
}

/// Without a human-normalised score where the game's mode or difficulty is another.
ReturnSummary summary_of(const EvaluationPlan& plan, const Evaluation& evaluation) {
    auto summary = summarise(evaluation, plan.env.game);
    if (is_variant(plan.env)) summary.human_normalised.reset();
    return summary;
}

}  // namespace

std::string evaluation_text(const EvaluationReport& report) {
    const auto& [source, protocol, sampled, policy_checksum, device, policy, plan, evaluation] = report;
    std::string text;
    const auto line = [&text](std::string_view name, const std::string& value) {
        text += fmt::format("{:<20}  {}\n", name, printable(value));
    };
    const std::string steps = provenance(policy, "agent_steps");
    line("policy", fmt::format("{} on {}{}, {}", policy.agent, policy.game,
                               steps.empty() ? "" : fmt::format(" after {} agent steps", steps), source));
    line("game", plan.env.game);
    line("protocol", fmt::format("{}, seed {}, {}, epsilon {}, {} no-ops at the start", protocol, plan.seed,
                                 sampled ? "sampled" : "greedy", plan.epsilon,
                                 plan.env.noop_max == 0 ? "no" : fmt::format("0 to {}", plan.env.noop_max)));
    const auto joystick = coordinates(plan.env) == Joystick::polar
                              ? ""
                              : fmt::format(", {} joystick", name_of(coordinates(plan.env)));
    line("environment",
         fmt::format("sticky {}, threshold {}{}", plan.env.sticky_probability, plan.env.threshold, joystick));
    if (const auto stick = changed_settings(plan.env.motion); !stick.empty()) line("stick", stick);

    std::int64_t length = 0, frames = 0;
    for (const auto& game : evaluation.games) {
        length += game.length;
        frames += game.frames;
    }
    const ReturnSummary summary = summary_of(plan, evaluation);
    line("games", fmt::format("{}, {} agent steps, {} frames", games_text(plan, evaluation), length, frames));
    line("return, mean", fmt::format("{:.2f}", summary.mean));
    line("  standard deviation", fmt::format("{:.2f}", summary.standard_deviation));
    line("  median", fmt::format("{:.2f}", summary.median));
    line("  interquartile mean", fmt::format("{:.2f}", summary.interquartile_mean));
    line("  minimum, maximum", fmt::format("{}, {}", summary.minimum, summary.maximum));
    line("  human-normalised",
         summary.human_normalised
             ? fmt::format("{:.4f} (0 is the published random score{})", *summary.human_normalised,
                           cuts_games_short(plan.env) ? "; of whole games, and these were cut off" : "")
         : is_variant(plan.env) ? "there is no human score of this mode and difficulty"
                                : "there is no human score of this game");
    line("random play", random_play(plan.env));
    line("events", event_shares(evaluation.events));
    return text;
}

void write_evaluation_report(const std::filesystem::path& folder, const EvaluationReport& report,
                             const std::string& name) {
    const auto& [source, protocol, sampled, policy_checksum, device, policy, plan, evaluation] = report;
    const ReturnSummary summary = summary_of(plan, evaluation);
    nlohmann::ordered_json env;
    EnvConfig config = plan.env;
    ConfigTable table;
    table.add("env", config);
    for (const auto& entry : table.entries()) env[entry.key] = entry.get();
    nlohmann::ordered_json json = {{"source", source},
                                   {"agent", policy.agent},
                                   {"trained_on", policy.game},
                                   {"agent_steps", provenance(policy, "agent_steps")},
                                   {"training_seed", provenance(policy, "seed")},
                                   {"policy_crc32c", policy_checksum},
                                   {"cale", cale_version()},
                                   {"protocol", protocol},
                                   {"seed", plan.seed},
                                   {"choice", sampled ? "sampled" : "greedy"},
                                   {"device", device},
                                   {"threads", at::get_num_threads()},
                                   {"epsilon", plan.epsilon},
                                   {"env", env},
                                   {"games", evaluation.games.size()},
                                   {"interrupted", evaluation.interrupted},
                                   {"steps", nullptr},
                                   {"mean", summary.mean},
                                   {"standard_deviation", summary.standard_deviation},
                                   {"median", summary.median},
                                   {"interquartile_mean", summary.interquartile_mean},
                                   {"minimum", summary.minimum},
                                   {"maximum", summary.maximum},
                                   {"human_normalised", nullptr},
                                   {"random_play", nullptr}};
    if (plan.steps != kNoLimit) json["steps"] = plan.steps;
    if (summary.human_normalised) json["human_normalised"] = *summary.human_normalised;
    if (const auto floor = random_floor(plan.env)) json["random_play"] = *floor;
    write_evaluation(folder / (name + ".csv"), evaluation);
    // The source is a path, which need not be UTF-8, as JSON must.
    write_file_atomically(folder / (name + ".json"),
                          json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

}  // namespace cale
