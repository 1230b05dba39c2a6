#include "agents/der.h"
#include "train/program.h"

int main(int argc, char** argv) {
    return cale::run_program("der", "Trains data-efficient Rainbow on an Atari 2600 game.", cale::make_der,
                             argc, argv);
}
