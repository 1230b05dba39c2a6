// The tables of a run, as a report and a resumed run read them.
#include <optional>

#include "fuzz.h"
#include "report/learning_curve.h"
#include "train/log.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const fuzz::Folder folder;
    const auto input = fuzz::text_of(data, size);
    const auto file = folder.write("table.csv", input);
    fuzz::accepts([&] { cale::read_progress(file); });
    fuzz::accepts([&] { cale::read_episodes(file); });
    fuzz::accepts([&] {
        cale::ProgressLog log(file, static_cast<std::int64_t>(size % 7));
        log.write({.global_step = 1, .frame = 2, .scalars = {{"losses/new", 3}}});
    });
    return 0;
}
