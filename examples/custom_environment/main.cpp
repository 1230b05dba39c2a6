// DQN in a world of one's own: configuration, logs, checkpoints, --resume and evaluations are those of every
// training program.
#include <agents/dqn.h>
#include <train/program.h>

#include "catch.h"

int main(int argc, char** argv) {
    return cale::run_program<example::CatchConfig>("dqn", "Trains a deep Q-network to catch a ball.",
                                                   cale::make_dqn, argc, argv);
}
