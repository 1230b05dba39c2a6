// What random play on the continuous joystick scores: made data/joystick_random_scores.csv.
//   joystick_random FILE GAMES STEPS SEED [GAME]
// Plays each of the 60 games, or GAME alone, under both protocols, in polar and in cartesian coordinates,
// until GAMES games have ended or STEPS agent steps are played; the game under way is played to its end.
// Every action is drawn uniformly from the box of the coordinates. FILE is written after each game; rows that
// it has already are kept, so the same command continues where it was stopped.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include <fmt/format.h>

#include "bench/command_line.h"
#include "cale/env.h"
#include "cale/fields.h"
#include "cale/games.h"
#include "cale/joystick.h"
#include "report/aggregate.h"

namespace {

constexpr auto kUsageLine = "joystick_random FILE GAMES STEPS SEED [GAME]";
constexpr auto kHeader = "game,protocol,joystick,games,cut_games,agent_steps,mean,low,high,rewarded_share";

struct Protocol {
    std::string name;
    cale::EnvConfig (*config)(std::string game);
};
const std::array<Protocol, 2> kProtocols{
    {{"200m", cale::protocol_200m}, {"atari100k", cale::protocol_atari100k}}};

constexpr std::array kJoysticks{cale::Joystick::polar, cale::Joystick::cartesian};

// (game, protocol, number in kJoysticks) -> line
using Rows = std::map<std::tuple<std::string, std::string, std::size_t>, std::string>;

// [0, 1): the standard leaves open what its distributions draw.
float uniform(std::mt19937_64& random) {
    return static_cast<float>(random() >> 40) * 0x1p-24F;
}

std::string play(const cale::Game& game, const Protocol& protocol, cale::Joystick joystick, std::size_t games,
                 std::int64_t steps, std::uint32_t seed) {
    const auto coordinates = cale::stick_coordinates(joystick);
    std::vector<float> drawn(coordinates.size());
    cale::Env env(protocol.config(std::string(game.rom)), seed);
    std::mt19937_64 random(seed);
    std::vector<std::uint8_t> observation(cale::kFrameSize);
    std::vector<double> returns;
    std::int64_t played = 0, rewarded = 0, cut = 0;
    while (returns.size() < games && played < steps) {
        env.reset(observation);
        double sum = 0;
        cale::StepResult result;
        while (!result.episode_over) {
            std::ranges::transform(coordinates, drawn.begin(), [&](const auto& axis) {
                const float centre = (axis.low + axis.high) / 2, half_width = (axis.high - axis.low) / 2;
                return centre + half_width * (2 * uniform(random) - 1);
            });
            result = env.step(cale::stick(joystick, drawn), observation);
            sum += result.reward;
            ++played;
            if (result.reward != 0) ++rewarded;
        }
        if (result.truncated) ++cut;
        returns.push_back(sum);
    }
    const cale::Estimate mean = cale::mean_of_runs(returns);
    return fmt::format("{},{},{},{},{},{},{:.6g},{:.6g},{:.6g},{:.4g}", game.name, protocol.name,
                       cale::name_of(joystick), returns.size(), cut, played, mean.value, mean.low, mean.high,
                       static_cast<double>(rewarded) / static_cast<double>(played));
}

Rows read_rows(const std::string& path) {
    Rows rows;
    std::ifstream file(path);
    std::string line;
    if (!std::getline(file, line)) return rows;
    if (line != kHeader)
        throw std::invalid_argument(path + " is no table of this program: choose another file");
    while (std::getline(file, line)) {
        const auto cells = cale::split(line, ',');
        const auto* const joystick =
            cells.size() < 3 ? kJoysticks.end()
                             : std::ranges::find(kJoysticks, cells[2], &cale::name_of<cale::Joystick>);
        if (joystick == kJoysticks.end())
            throw std::invalid_argument(
                fmt::format("{} has a row without a game or a joystick: {}", path, line));
        rows[{cells[0], cells[1], joystick - kJoysticks.begin()}] = line;
    }
    return rows;
}

// Complete at any time: a row is there or not.
void write_rows(const std::string& path, const Rows& rows) {
    const std::string unfinished = path + ".tmp";
    std::ofstream file(unfinished);
    file << kHeader << '\n';
    for (const auto& [key, line] : rows) file << line << '\n';
    file.close();
    if (!file) throw std::runtime_error("cannot write " + unfinished);
    std::filesystem::rename(unfinished, path);
}

int measure(int argc, char** argv) {
    if (argc != 5 && argc != 6) return bench::kUsage;
    const std::string path = argv[1];
    const auto games = static_cast<std::size_t>(bench::whole_number("GAMES", argv[2], 1, 1'000'000));
    const auto steps = bench::whole_number("STEPS", argv[3], 1, 1'000'000'000);
    const auto seed = static_cast<std::uint32_t>(bench::whole_number("SEED", argv[4], 0, 0xFFFF'FFFF));
    const cale::Game* const only = argc == 6 ? &cale::find_game(argv[5]) : nullptr;

    Rows rows = read_rows(path);
    for (const cale::Game& game : cale::games()) {
        if (only != nullptr && &game != only) continue;
        for (const Protocol& protocol : kProtocols) {
            for (std::size_t i = 0; i < kJoysticks.size(); ++i) {
                std::string& row = rows[{std::string(game.name), protocol.name, i}];
                if (!row.empty()) continue;
                row = play(game, protocol, kJoysticks[i], games, steps, seed);
                write_rows(path, rows);
                std::puts(row.c_str());
                std::fflush(stdout);
            }
        }
    }
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    return bench::run(kUsageLine, measure, argc, argv);
}
