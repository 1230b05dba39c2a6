#include "sweep/run_folder.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include "cale/text.h"
#include "storage/files.h"
#include "storage/metadata_text.h"
#include "storage/run_lock.h"
#include "storage/step_name.h"
#include "sweep/child.h"
#include "sweep/shell.h"
#include "train/resume.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

constexpr const char* kClaim = ".claim";
constexpr const char* kLock = ".lock";  // see RunLock
constexpr const char* kOutput = "output.log";
constexpr const char* kFailure = "failure.txt";

/// The end of a file, which may be long.
std::string tail(const fs::path& file, std::int64_t bytes) {
    std::ifstream in(file, std::ios::binary | std::ios::ate);
    if (!in) return "";
    const auto size = static_cast<std::int64_t>(in.tellg());
    const auto count = std::min(size, bytes);
    in.seekg(size - count);
    std::string text(static_cast<std::size_t>(count), '\0');
    in.read(text.data(), count);
    text.resize(static_cast<std::size_t>(in.gcount()));
    return text;
}

/// Puts what the newest row of progress.csv says into `status`.
void read_newest_report(const fs::path& file, RunStatus& status) {
    std::ifstream in(file);
    std::string header;
    if (!std::getline(in, header)) return;
    auto text = tail(file, 16'384);
    text.resize(text.rfind('\n') == text.npos ? 0 : text.rfind('\n'));  // a row under way does not count
    const auto row = text.substr(text.rfind('\n') + 1);
    const auto names = split(header, ',');
    const auto cells = split(row, ',');
    if (row == header || cells.size() != names.size()) return;
    for (std::size_t i = 0; i < names.size(); ++i) {
        const double value = number_in<double>(cells[i]).value_or(NAN);
        if (!std::isfinite(value)) continue;
        constexpr double kMostSteps = 1e15;  // a table may hold anything
        if (names[i] == "global_step" && value >= 0 && value <= kMostSteps)
            status.step = static_cast<std::int64_t>(value);
        if (names[i] == "steps_per_second") status.steps_per_second = value;
        if (names[i] == "charts/avg_episodic_return") status.mean_return = value;
    }
}

struct flock whole_file(short type) {
    struct flock lock {};
    lock.l_type = type;
    lock.l_whence = SEEK_SET;
    return lock;
}

}  // namespace

std::span<const std::string_view> names_of(RunPhase) {
    static constexpr std::string_view names[] = {"waiting",  "interrupted", "running",
                                                 "finished", "failed",      "refused"};
    return names;
}

bool is_finished(const fs::path& folder, const RunEnd& end) {
    const auto step = newest_checkpoint_step(folder);
    if (!step || *step < end.total_steps) return false;
    if (!end.evaluates) return true;
    if (newest_step(folder / "eval", ".csv").value_or(0) < end.total_steps) return false;
    try {
        // Behind the evaluation's table the checkpoint is written once more, with its score, and the
        // metadata.
        return !metadata_say_unfinished(folder);
    } catch (const std::system_error&) {
        return false;  // config_mismatch() names a file that cannot be read
    }
}

RunStatus status_of(const fs::path& folder, const RunEnd& end) {
    RunStatus status;
    std::error_code ignored;
    read_newest_report(folder / "progress.csv", status);
    const auto saved_step = newest_checkpoint_step(folder);
    status.step = std::max(status.step, saved_step.value_or(0));
    if (RunClaim::is_taken(folder)) {
        status.state = RunPhase::running;
    } else if (is_finished(folder, end)) {
        status.state = RunPhase::finished;
    } else if (fs::exists(folder / kFailure, ignored)) {
        status.state = RunPhase::failed;
        status.message = tail(folder / kFailure, 4096);
    } else if (saved_step) {
        status.state = RunPhase::interrupted;
        status.step = *saved_step;
    }
    return status;
}

std::string strange_file(const fs::path& folder) {
    constexpr std::array<std::string_view, 10> kBegun = {
        kClaim,          kLock,         kOutput,        kFailure,       "config.yaml",
        "metadata.json", "checkpoints", "progress.csv", "episodes.csv", "joystick_events.csv"};
    const auto is_begun = [&](std::string_view name) {
        const auto written =
            name.substr(0, name.find(".tmp-"));  // the name that write_file_atomically() gives it
        return std::ranges::find(kBegun, written) != kBegun.end() || name.starts_with("events.out.tfevents");
    };
    std::error_code ignored;
    for (const auto& item : fs::directory_iterator(folder, ignored))
        if (auto name = item.path().filename().string(); !is_begun(name)) return name;
    for (const auto& item : fs::directory_iterator(folder / "checkpoints", ignored))
        if (item.path().extension() != ".partial") return "checkpoints/" + item.path().filename().string();
    // A run writes its metadata first. Asked again, as another sweep may have removed both meanwhile.
    const auto config = folder / "config.yaml";
    if (fs::exists(config, ignored) && !fs::exists(folder / "metadata.json", ignored) &&
        fs::exists(config, ignored))
        return "config.yaml";
    return "";
}

void prepare_for_start(const fs::path& folder) {
    fs::create_directories(folder);
    // First: without metadata.json beside it strange_file() would name it.
    fs::remove(folder / "config.yaml");
    for (const auto& item : fs::directory_iterator(folder)) {
        const auto name = item.path().filename();
        if (name != kClaim && name != kLock && name != kOutput) fs::remove_all(item.path());
    }
}

void remember_failure(const fs::path& folder, std::string_view reason) {
    write_file_atomically(folder / kFailure, reason);
}

void forget_failure(const fs::path& folder) {
    fs::remove(folder / kFailure);
}

fs::path output_file(const fs::path& folder) {
    return folder / kOutput;
}

std::int64_t log_size(const fs::path& folder) {
    std::error_code missing;
    const auto size = fs::file_size(output_file(folder), missing);
    return missing ? 0 : static_cast<std::int64_t>(size);
}

std::string last_log_line(const fs::path& folder, std::int64_t from) {
    const auto written = std::max<std::int64_t>(0, log_size(folder) - from);
    const auto text = without_line_end(tail(output_file(folder), std::min<std::int64_t>(4096, written)));
    return text.substr(text.rfind('\n') + 1);
}

// ---- the claim ----------------------------------------------------------------------

// An "open file description" lock: of the descriptor rather than the process, so that a child inherits it,
// and known to network file systems.
std::optional<RunClaim> RunClaim::take(const fs::path& folder) {
    const auto file = folder / kClaim;
    RunClaim claim(Descriptor(above_standard_streams(::open(file.c_str(), O_RDWR | O_CREAT, 0666))));
    if (!claim.file_.is_open())
        throw std::system_error(errno, std::generic_category(),
                                fmt::format("cannot open '{}'", file.string()));
    auto all = whole_file(F_WRLCK);
    const bool taken =
        ::fcntl(claim.file_.get(), F_OFD_SETLK, &all) != 0 && (errno == EAGAIN || errno == EACCES);
    if (taken || RunLock::is_taken(folder)) return std::nullopt;
    return claim;
}

bool RunClaim::is_taken(const fs::path& folder) {
    if (const Descriptor file(::open((folder / kClaim).c_str(), O_RDWR | O_CLOEXEC)); file.is_open()) {
        auto all = whole_file(F_WRLCK);
        const bool answered = ::fcntl(file.get(), F_OFD_GETLK, &all) == 0;
        // In this order: a program that a sweep has just started must not find its lock taken by this
        // question.
        if (answered && all.l_type != F_UNLCK) return true;
    }
    return RunLock::is_taken(folder);
}

}  // namespace cale
