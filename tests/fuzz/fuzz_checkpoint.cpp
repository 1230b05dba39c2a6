// A checkpoint's folder. Input: a byte that says which file it replaces, then its contents, which the
// manifest calls good: the manifest itself, state.json, agent.safetensors.zst, games.safetensors; or changes
// to good games: which tensor, two bytes where, and what to put there (or, with its upper bit set, to how
// many bytes to cut it).
#include <array>
#include <memory>
#include <vector>

#include <ATen/Parallel.h>

#include "agents/dqn.h"
#include "fuzz.h"
#include "storage/files.h"
#include "train/checkpoint.h"
#include "train/collector.h"
#include "train/training_world.h"

namespace {

namespace fs = std::filesystem;
using cale::TensorMap;

/// A run of one small agent and one game, three steps old, with its checkpoint.
struct TrainedRun {
    fuzz::Folder folder;
    fs::path run = folder / "run";
    std::unique_ptr<cale::Agent> agent = make_agent();
    cale::Collector games{cale::training_world(breakout(), {}).make, /*num_envs=*/1, /*seed=*/1};
    cale::RunState state;
    TensorMap good_games;
    cale::StoredCheckpoint good;

    TrainedRun() {
        at::set_num_threads(1);
        fs::create_directories(run);
        std::vector<cale::Episode> ended;
        for (int step = 0; step < 3; ++step) {
            const auto actions = agent->act(games.observations(), cale::ActMode::train);
            games.step(actions);
            games.record(actions, *agent, state, ended);
        }
        good_games = games.state();
        good = cale::write_checkpoint(run, {.state = state, .agent = agent->state(), .games = good_games},
                                      nullptr, nullptr);
    }

    static cale::EnvConfig breakout() {
        auto config = cale::protocol_200m("breakout");
        config.action_space = cale::ActionSet::full;
        return config;
    }
    static std::unique_ptr<cale::Agent> make_agent() {
        cale::DqnConfig config;
        config.hidden_units = 1;
        config.replay.replay_capacity = 100;
        return cale::make_dqn(config, {.action_space = cale::Discrete{18}});
    }

    void replace(const std::string& name, std::string_view bytes) const {
        auto manifest = good.manifest;
        cale::write_file_atomically(good.folder / name, bytes);
        manifest[name] = cale::record_of(good.folder / name);
        cale::write_manifest(good.folder, manifest);
    }

    TensorMap edited_games(std::string_view edits) const {
        TensorMap edited;
        std::vector<std::string> names;
        for (const auto& [name, tensor] : good_games) {
            edited[name] = tensor.clone();
            names.push_back(name);
        }
        while (edits.size() >= 4) {
            const auto which = fuzz::take_number(edits, 1);
            const auto place = fuzz::take_number(edits, 2);
            const auto value = fuzz::take(edits, 1).front();
            auto& tensor = edited[names[which % 128 % names.size()]];
            if (which >= 128) {
                tensor = tensor.flatten().slice(0, 0, static_cast<std::int64_t>(place)).clone();
            } else if (tensor.nbytes() > 0) {
                static_cast<char*>(tensor.data_ptr())[place % tensor.nbytes()] = value;
            }
        }
        return edited;
    }
};

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static TrainedRun world;
    auto input = fuzz::text_of(data, size);
    const auto which = fuzz::take_number(input, 1) % 5;
    const std::array names{"manifest.json", "state.json", "agent.safetensors.zst", "games.safetensors"};
    auto games = world.good_games;
    if (which == 4) games = world.edited_games(input);
    world.good = cale::write_checkpoint(
        world.run, {.state = world.state, .agent = world.agent->state(), .games = games}, nullptr, nullptr);
    if (which == 0)
        cale::write_file_atomically(world.good.folder / names[0], input);
    else if (which < 4)
        world.replace(names[which], input);
    fuzz::accepts([&] {
        cale::load_newest_checkpoint(world.run, *world.agent,
                                     [&](const TensorMap& stored) { world.games.restore(stored); });
    });
    return 0;
}
