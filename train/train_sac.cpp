#include "agents/sac.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program(
        "sac", "Trains soft actor-critic on an Atari 2600 game with the continuous joystick of CALE.",
        cale::make_sac, argc, argv);
}
