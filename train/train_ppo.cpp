#include "agents/ppo.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program(
        "ppo",
        "Trains a proximal policy optimisation (PPO) agent on an Atari 2600 game, in one "
        "process or, started by torchrun, in several (docs/distributed.md). Presets: "
        "configs/ppo/ram.yaml (from the console's memory), configs/ppo/atari100k.yaml "
        "(the paper's); without one a run has 200 million frames.",
        cale::make_ppo, argc, argv);
}
