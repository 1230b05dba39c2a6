// metadata.json: how a run was made, how long it has been trained, and how it ended
//
//     program, exp_name, env_id, seed, rom, rom_md5          what is trained
//     cale, commit, ale, libtorch, command, started,         the first session
//     host, cpu, device, threads, processes
//     wall_seconds                                           of all sessions, evaluations included
//     finished, stopped                                      whether it came to its end; why it ended before
//                                                            (null: it did not, or was killed)
//     resumed                                                the later sessions, with the same keys
//     schedule_over_run                                      see agents/agent.h
//     accepted_changes                                       settings changed during the run, and when
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace cale {

/// What is trained.
struct RunIdentity {
    std::string program;                        // "train_sac"
    std::string agent;                          // "sac"
    std::string env_id;                         // "ALE/Pong-v5"
    std::int64_t seed = 1;                      // train.seed
    std::vector<std::filesystem::path> roms{};  // the games' files; empty: of a world that has none
};

/// One session of training; the other entries of metadata.json are looked up.
struct Session {
    std::string command;
    std::string device;
    int threads = 1;
    int processes = 1;
};

/// The file's contents, and the clock of this session. Unknown keys are preserved.
class Metadata {
  public:
    /// For a new run. Throws std::runtime_error where the ROM cannot be read.
    Metadata(const std::filesystem::path& run_dir, const RunIdentity& identity, const Session& session);
    /// Reads those of a run that is resumed; none if it has no metadata.json. Throws std::runtime_error, with
    /// a remedy, for a damaged file, which is left unchanged.
    static std::optional<Metadata> read(const std::filesystem::path& run_dir);
    ~Metadata();
    Metadata(Metadata&&) noexcept;
    Metadata& operator=(Metadata&&) noexcept;

    /// Of the first session; none if not recorded.
    std::optional<int> threads() const;
    /// Of the newest session; none if not recorded.
    std::optional<std::string> device() const;
    /// Whether the newest session came to the run's end.
    bool finished() const;

    /// Begins a session. `trained_seconds`: the run's earlier training time, used if the file does not record
    /// it.
    void resume(const Session& session, double trained_seconds);
    /// Whether this process's session is part of them: of a run that is resumed, once it has begun.
    bool has_this_session() const { return has_this_session_; }
    void add_change(const std::string& changes);
    /// The newest of these; empty where there is none.
    std::string newest_change() const;
    /// The key of the setting by which a schedule lasts for the whole run; empty: there is none.
    void set_schedule_over_run(const std::string& key);
    void finish();
    void stop(const std::string& why);

    /// Updates wall_seconds and writes the file. Throws std::system_error.
    void write();

  private:
    struct Contents;
    explicit Metadata(const std::filesystem::path& run_dir);
    std::filesystem::path file_;
    std::unique_ptr<Contents> contents_;
    bool has_this_session_ = true;
    double seconds_before_ = 0;  // of earlier sessions
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace cale
