// A replay's files. Input: a byte that says which of them it is about, and their contents before compression
// (so that their checksums are right) or, with the byte's upper half set, the file as it is.
#include <array>

#include "fuzz.h"
#include "replay/replay_buffer.h"
#include "replay/replay_file.h"
#include "replay/replay_snapshot.h"

namespace {

constexpr std::array<std::array<const char*, 2>, 3> kFiles{
    {{"replay.zst", "CALE-RPL"}, {"frames-open.zst", "CALE-FRM"}, {"transitions-open.zst", "CALE-TRN"}}};

cale::ReplayConfig config() {
    return {.capacity = 64, .num_envs = 2, .observation = {2, {1, 4}}, .action_size = 0, .prioritised = true};
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const fuzz::Folder folder;
    auto input = fuzz::text_of(data, size);
    const auto which = fuzz::take_number(input, 1);
    cale::ReplayBuffer good(config());
    const std::array<std::uint8_t, 4> frame{1, 2, 3, 4};
    for (int step = 0; step < 3; ++step) good.add(step % 2, {.frame = frame, .reward = 1});
    const std::filesystem::path saved = folder / "replay";
    std::filesystem::create_directories(saved);
    save_replay(good, saved);

    const auto [name, magic] = kFiles[which % kFiles.size()];
    if (which >= 128) {
        folder.write(std::string("replay/") + name, input);
    } else {
        cale::ReplayFileWriter file(saved / name, magic, 3);
        file.write(input.data(), input.size());
        file.commit();
    }
    cale::ReplayBuffer loaded(config());
    if (!fuzz::accepts([&] { load_replay(loaded, saved); })) return 0;
    // What was accepted can be used.
    for (int step = 0; step < 100; ++step) loaded.add(step % 2, {.frame = frame, .reward = 1});
    std::mt19937_64 random(1);
    fuzz::accepts([&] { loaded.sample(8, random); });
    return 0;
}
