// Loads a policy, if there is one, and acts on an empty screen.
#include <cstdint>
#include <cstdio>
#include <exception>
#include <vector>

#include <policy/observer.h>
#include <policy/policy_lite.h>

int main(int argc, char** argv) {
    try {
        const auto policy = cale::lite::Policy::load(argc > 1 ? argv[1] : "missing.safetensors");
        auto workspace = policy.workspace();
        cale::Observer observer(policy.info());
        observer.start(std::vector<std::uint8_t>(210 * 160));
        const auto decision = policy.act(observer.observation(), workspace);
        std::printf("%s: event %d\n", policy.info().game.c_str(), static_cast<int>(decision.event));
        return 0;
    } catch (const std::exception& error) {
        std::printf("refused: %s\n", error.what());
        return argc > 1 ? 1 : 0;
    }
}
