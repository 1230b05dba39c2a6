#include "agents/der.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program(
        "der",
        "Trains a data-efficient Rainbow (DER) agent on an Atari 2600 game. Presets: "
        "configs/der/ram100k_joystick.yaml (the joystick, from the console's memory), "
        "configs/der/joystick100k.yaml (the joystick, from pixels), "
        "configs/der/atari100k.yaml (the paper's, with discrete actions). Without one the "
        "agent has the settings of configs/der/atari100k.yaml but for agent.replay_capacity, and a "
        "run lasts 200 million frames; configs/der/200m.yaml has Rainbow's settings for such a run.",
        cale::make_der, argc, argv);
}
