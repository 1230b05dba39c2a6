#include "agents/dqn.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program("dqn", "Trains a deep Q-network on an Atari 2600 game.", cale::make_dqn, argc,
                             argv);
}
