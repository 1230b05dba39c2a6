#include "terminal/failure.h"

#include <algorithm>
#include <filesystem>
#include <new>
#include <utility>

#include <c10/util/Exception.h>
#include <fmt/format.h>

#include "cale/text.h"

namespace cale {
namespace {

/// Libraries end their texts with line breaks, or put some inside.
std::string one_sentence(std::string text) {
    text.erase(text.find_last_not_of(" \n") + 1);
    std::ranges::replace(text, '\n', ' ');
    return printable(text);
}

}  // namespace

std::string failure_sentence(const std::exception& error) {
    if (const auto* file = dynamic_cast<const std::filesystem::filesystem_error*>(&error))
        return one_sentence(
            fmt::format("cannot use '{}': {}", file->path1().string(), file->code().message()));
    const auto* torch = dynamic_cast<const c10::Error*>(&error);
    std::string text = torch != nullptr ? torch->what_without_backtrace() : error.what();
    // LibTorch tells no type of them apart, on the CPU and on GPUs.
    const bool memory = dynamic_cast<const std::bad_alloc*>(&error) != nullptr ||
                        (torch != nullptr && (text.find("can't allocate memory") != text.npos ||
                                              text.find("out of memory") != text.npos));
    if (!memory) return one_sentence(std::move(text));
    return "there is not enough memory; free some, or ask for less: smaller batches, networks, rollouts or "
           "replay, fewer games at once";
}

}  // namespace cale
