#include "agents/sac.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program(
        "sac",
        "Trains a soft actor-critic (SAC) agent on an Atari 2600 game with CALE's continuous joystick. "
        "Presets: "
        "configs/sac/ram100k_plus.yaml (from the console's memory), configs/sac/atari100k_plus.yaml (from "
        "pixels), configs/sac/atari100k.yaml (the paper's); without one a run has 200 million frames.",
        cale::make_sac, argc, argv);
}
