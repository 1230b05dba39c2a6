// What a checkpoint of a full replay costs, with the frames of a real game played at random:
//   replay_checkpoint GAME TRANSITIONS FOLDER
// Prints the time that the snapshot takes from training, the time and bytes of a first checkpoint, of one
// after 10,000 more steps whose full chunks are taken over, and the time to load it. FOLDER is made, and
// removed in the end.
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "bench/command_line.h"
#include "cale/vector_env.h"
#include "replay/replay_snapshot.h"

namespace {

namespace fs = std::filesystem;

/// A game played at random into a replay.
class Player {
  public:
    Player(const std::string& game, cale::ReplayBuffer& replay)
        : env_(config_of(game), seeds()), replay_(replay) {
        env_.reset(frames_);
    }

    void play(std::int64_t steps) {
        std::uniform_real_distribution<float> unit(0, 1);
        constexpr auto kPi = std::numbers::pi_v<float>;
        for (std::int64_t step = 0; step < steps; step += kGames) {
            for (auto& action : actions_)
                action = {unit(random_), kPi * (2 * unit(random_) - 1), unit(random_)};
            env_.step(actions_, next_, final_, results_);
            for (std::size_t i = 0; i < kGames; ++i) {
                const std::array<float, 3> action{actions_[i].radius, actions_[i].theta, actions_[i].fire};
                replay_.add(static_cast<std::int64_t>(i), {.frame = of(frames_, i),
                                                           .action = action,
                                                           .reward = results_[i].reward,
                                                           .terminal = results_[i].terminal,
                                                           .truncated = results_[i].truncated,
                                                           .final_frame = of(final_, i)});
            }
            std::swap(frames_, next_);
        }
    }

    static constexpr std::size_t kGames = 8;

  private:
    static cale::EnvConfig config_of(const std::string& game) {
        auto config = cale::protocol_200m(game);
        config.num_envs = kGames;
        return config;
    }
    static std::vector<std::uint32_t> seeds() { return {1, 2, 3, 4, 5, 6, 7, 8}; }
    static std::span<const std::uint8_t> of(const std::vector<std::uint8_t>& frames, std::size_t i) {
        return std::span(frames).subspan(i * cale::kFrameSize, cale::kFrameSize);
    }

    cale::VectorEnv env_;
    cale::ReplayBuffer& replay_;
    std::mt19937 random_{1};
    std::vector<cale::ContinuousAction> actions_ = std::vector<cale::ContinuousAction>(kGames);
    std::vector<cale::StepResult> results_ = std::vector<cale::StepResult>(kGames);
    std::vector<std::uint8_t> frames_ = std::vector<std::uint8_t>(kGames * cale::kFrameSize);
    std::vector<std::uint8_t> next_ = frames_, final_ = frames_;
};

template <class Work>
double seconds(const Work& work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

double megabytes(const fs::path& folder) {
    double bytes = 0;
    for (const auto& entry : fs::directory_iterator(folder)) bytes += static_cast<double>(entry.file_size());
    return bytes / 1e6;
}

int measure(int argc, char** argv) {
    if (argc != 4) return bench::kUsage;
    cale::ReplayConfig config;
    config.capacity = bench::whole_number("TRANSITIONS", argv[2], 1'000, 1'000'000'000);
    if (fs::exists(argv[3])) {
        throw std::invalid_argument(std::string("FOLDER is '") + argv[3] +
                                    "', which is there already: name a new one, which is removed in the end");
    }
    config.num_envs = Player::kGames;
    cale::ReplayBuffer replay(config);
    Player player(argv[1], replay);
    player.play(config.capacity + 1000);
    const fs::path folder = argv[3], first = folder / "first", second = folder / "second";
    fs::create_directories(first);
    fs::create_directories(second);

    const auto took = [&](const fs::path& into, const cale::ReplaySnapshot::TakeOver& take_over) {
        double save = 0;
        const double all = seconds([&] {
            cale::ReplaySnapshot snapshot(replay);
            save = seconds([&] { snapshot.save(into, take_over); });
        });
        std::printf("%s: snapshot %.1f ms, written in %.2f s, %.1f MB\n", into.filename().c_str(),
                    1e3 * (all - save), save, megabytes(into));
    };
    std::printf("%s, %lld transitions\n", argv[1], static_cast<long long>(replay.size()));
    took(first, {});
    player.play(10'000);
    took(second, [&](const std::string& file) {
        std::error_code refused;
        fs::create_hard_link(first / file, second / file, refused);
        return !refused;
    });
    cale::ReplayBuffer loaded(config);
    std::printf("loaded in %.2f s\n", seconds([&] { load_replay(loaded, second); }));
    fs::remove_all(folder);
    return loaded.size() == replay.size() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run("replay_checkpoint GAME TRANSITIONS FOLDER", measure, argc, argv);
}
