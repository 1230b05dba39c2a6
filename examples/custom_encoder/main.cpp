// A training program: configuration, command line, logs, checkpoints, --resume and evaluation come with
// run_program().
#include <train/program.h>

#include "patch_dqn.h"

int main(int argc, char** argv) {
    return cale::run_program("patch_dqn", "Trains a deep Q-network that sees an Atari 2600 game in patches.",
                             example::make_patch_dqn, argc, argv);
}
