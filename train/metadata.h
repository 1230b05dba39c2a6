// metadata.json: what a run was made with, for how long it has been trained, and how it ended
//
//     program, exp_name, env_id, seed, rom, rom_md5          what is trained
//     cale, commit, ale, libtorch, command, started,         the sitting in which it began
//     host, cpu, device, threads, processes
//     wall_seconds                                           of all sittings, evaluations included
//     finished, stopped                                      why it ended early; null: it runs, or was killed
//     resumed                                                the later sittings, in the same words
//     schedule_over_run                                      see AgentSpec
//     accepted_changes                                       settings that were changed in mid-run, and when
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

namespace cale {

/// What is trained.
struct RunIdentity {
    std::string program;          // "train_sac"
    std::string agent;            // "sac"
    std::string env_id;           // "ALE/Pong-v5"
    std::int64_t seed = 1;        // train.seed
    std::filesystem::path rom{};  // the file; empty: of a world that has none
};

/// One process that trains a run for a while; the rest of what metadata.json says of it is looked up.
struct Sitting {
    std::string command;
    std::string device;
    int threads = 1;
    int processes = 1;
};

/// The file's contents, and the clock of this sitting. Keys of other versions stay as they are.
class Metadata {
  public:
    /// Of a new run. Throws std::runtime_error where the ROM cannot be read.
    Metadata(const std::filesystem::path& run_dir, const RunIdentity& identity, const Sitting& sitting);
    /// Those of a run that is resumed; none where it has no metadata.json. Throws std::runtime_error, with
    /// the way out, where the file is damaged: it is left as it is.
    static std::optional<Metadata> read(const std::filesystem::path& run_dir);
    ~Metadata();
    Metadata(Metadata&&) noexcept;
    Metadata& operator=(Metadata&&) noexcept;

    /// Of the first sitting; none where it is not said.
    std::optional<int> threads() const;

    /// A sitting begins. `trained_seconds`: the run's before it, where the file does not say.
    void resume(const Sitting& sitting, double trained_seconds);
    void add_change(const std::string& changes);
    /// The key of the setting by which a schedule lasts for the whole run; empty: there is none.
    void set_schedule_over_run(const std::string& key);
    void finish();
    void stop(const std::string& why);

    /// Brings wall_seconds up to date and writes the file. Throws std::system_error.
    void write();

  private:
    struct Contents;
    explicit Metadata(const std::filesystem::path& run_dir);
    std::filesystem::path file_;
    std::unique_ptr<Contents> contents_;
    double seconds_before_ = 0;  // of earlier sittings
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace cale
