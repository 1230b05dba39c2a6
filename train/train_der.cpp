#include "agents/der.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program("der",
                             "Trains a data-efficient Rainbow (DER) agent on an Atari 2600 game. Presets: "
                             "configs/der/ram100k_joystick.yaml (the joystick, from the console's memory), "
                             "configs/der/joystick100k.yaml (the joystick, from pixels), "
                             "configs/der/atari100k.yaml (the paper's, with discrete actions). Without one a "
                             "run has the agent of the paper's and 200 million frames, for which "
                             "configs/der/200m.yaml has Rainbow's.",
                             cale::make_der, argc, argv);
}
