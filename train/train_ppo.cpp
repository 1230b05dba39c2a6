#include "agents/ppo.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program("ppo",
                             "Trains proximal policy optimisation on an Atari 2600 game, in one process or "
                             "as torchrun starts it in several (docs/distributed.md).",
                             cale::make_ppo, argc, argv);
}
