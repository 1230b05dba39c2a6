// Shell scripts in the place of the training programs: they behave as the setting agent.mode says.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "support/temporary_folder.h"
#include "sweep/plan.h"

namespace test {

/// A folder with train_fake, a ROM of Pong, and place for a sweep's runs.
///
/// train_fake knows every env setting, agent.mode, agent.size, agent.loss (huber), agent.rate (1e-4),
/// log.every, and train.total_steps (100, of three digits); agent.size=9 does not go with agent.loss=mse. It
/// writes the files of a run of so many steps:
///   fast          at once
///   slow          once the file `go` is in this folder; SIGINT and SIGTERM end it at a checkpoint of step 50
///   fail_once     fails the first time, at a checkpoint of step 50
///   fail          fails always
///   unresumable   leaves with exit code 3
///   diverge       leaves with exit code 4
///   killed_once   kills itself by SIGKILL the first time
class FakeProgram {
  public:
    FakeProgram();

    /// Runs in these modes, called "fast_0", "slow_1", ...
    std::vector<cale::PlannedRun> runs(const std::vector<std::string>& modes) const;
    /// Lets the slow ones finish.
    void go() const { folder_.write("go", ""); }
    /// Whether SIGINT and SIGTERM would end a slow run at a checkpoint by now.
    bool ready(const std::string& run) const { return std::filesystem::exists(path() / ("ready_" + run)); }

    std::filesystem::path path() const { return folder_.path(); }
    std::filesystem::path sweep() const { return folder_.path() / "runs"; }
    /// What a run wrote to its terminal.
    std::string output(const std::string& run) const { return folder_.read("runs/" + run + "/output.log"); }
    std::filesystem::path write(const std::string& name, const std::string& text) const {
        return folder_.write(name, text);
    }
    /// The same, and executable.
    std::filesystem::path write_script(const std::string& name, const std::string& text) const;

  private:
    TemporaryFolder folder_;
};

/// Waits until `happened()`, for ten seconds at most; whether it did.
template <class Condition>
bool wait_until(const Condition& happened) {
    for (int i = 0; i < 500; ++i) {
        if (happened()) return true;
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    return false;
}

}  // namespace test
