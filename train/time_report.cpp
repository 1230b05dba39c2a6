#include "train/time_report.h"

#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

#include "train/log.h"

namespace cale {

double total_seconds(const TimeSplit& split) {
    double sum = 0;
    for (const auto& [name, part] : kTimeParts) sum += split.*part;
    return sum;
}

std::string time_report(const std::filesystem::path& run_dir) {
    const auto path = run_dir / "progress.csv";
    if (!std::filesystem::exists(run_dir))
        throw std::runtime_error(fmt::format("there is no folder {}", run_dir.string()));
    if (!std::filesystem::exists(path))
        throw std::runtime_error(
            fmt::format("{} has no progress.csv: give the folder of a run", run_dir.string()));
    const auto columns = read_progress(path);
    const auto column = [&](const std::string& name) -> const std::vector<double>& {
        const auto found = columns.find(name);
        if (found == columns.end() || found->second.empty()) {
            throw std::runtime_error(
                fmt::format("{} has no {} yet: a run writes it with its first row, after log.every agent "
                            "steps or at its end",
                            path.string(), name));
        }
        return found->second;
    };
    const auto& seconds = column("seconds");
    const auto& step_of = column("global_step");
    const auto steps = step_of.back();
    if (!std::isfinite(steps) || !std::isfinite(seconds.back()))
        throw std::runtime_error(
            fmt::format("{} is damaged: a row without steps or seconds; remove it", path.string()));
    TimeSplit split;
    for (const auto& [name, part] : kTimeParts) {
        // Runs from before 2026-12 have evaluations in their log's share.
        if (name == "evaluation" && !columns.contains("time/evaluation")) continue;
        const auto& shares = column(fmt::format("time/{}", name));
        double before = 0;
        for (std::size_t row = 0; row < shares.size(); ++row) {
            if (!std::isnan(shares[row])) split.*part += shares[row] * (seconds[row] - before);
            before = seconds[row];
        }
    }
    double timed_steps = 0;  // of the rows with times: a finished run that is resumed writes one without
    const auto& logged = column("time/log");
    for (std::size_t row = 0; row < logged.size(); ++row)
        if (!std::isnan(logged[row])) timed_steps += step_of[row] - (row > 0 ? step_of[row - 1] : 0);
    if (timed_steps == 0)
        throw std::runtime_error(
            fmt::format("{} has no row with times: the run was resumed after its end", path.string()));
    std::string text = fmt::format(
        "{}: {:.0f} agent steps in {:.1f} s, {:.1f} a second\n\n{:<12} {:>6} {:>12}\n", run_dir.string(),
        steps, seconds.back(), steps / seconds.back(), "", "share", "ms per step");
    for (const auto& [name, part] : kTimeParts) {
        text += fmt::format("{:<12} {:>5.1f}% {:>12.3f}\n", name, 100 * (split.*part) / total_seconds(split),
                            1000 * (split.*part) / timed_steps);
    }
    return text;
}

}  // namespace cale
