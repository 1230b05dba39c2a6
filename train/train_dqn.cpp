#include "agents/dqn.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program("dqn",
                             "Trains a deep Q-network (DQN) agent on an Atari 2600 game. Preset: "
                             "configs/dqn/atari100k.yaml; without one a run has 200 million frames.",
                             cale::make_dqn, argc, argv);
}
