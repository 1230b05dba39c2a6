#include "examples/custom_agent/a2c.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program("a2c", "Trains advantage actor-critic on an Atari 2600 game.", cale::make_a2c,
                             argc, argv);
}
