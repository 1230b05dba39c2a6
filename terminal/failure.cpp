#include "terminal/failure.h"

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <new>
#include <system_error>

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

std::string text_of(const std::exception& error) {
    const auto* torch = dynamic_cast<const c10::Error*>(&error);
    return torch != nullptr ? torch->what_without_backtrace() : error.what();
}

bool is_full(const std::error_code& reason) {
    return reason == std::errc::no_space_on_device ||
           reason == std::error_code(EDQUOT, std::generic_category());
}

/// What to do about a file that the system refused; nothing where its reason says that.
std::string remedy_of(const std::error_code& reason, bool may_move) {
    if (is_full(reason))
        return may_move ? "; make room there, or choose another folder" : "; make room there";
    if (reason == std::errc::read_only_file_system)
        return may_move ? "; choose another folder" : "; make it writable";
    if (reason == std::errc::permission_denied)
        return may_move ? "; change its permissions, or choose another path" : "; change its permissions";
    return "";
}

}  // namespace

bool is_out_of_memory(const std::exception& error) {
    if (dynamic_cast<const std::bad_alloc*>(&error) != nullptr) return true;
    if (const auto* const system = dynamic_cast<const std::system_error*>(&error))
        return system->code() == std::errc::not_enough_memory;
    // LibTorch has no type of its own for it, on the CPU or on GPUs.
    const auto text = text_of(error);
    return dynamic_cast<const c10::Error*>(&error) != nullptr &&
           (text.find("can't allocate memory") != text.npos || text.find("out of memory") != text.npos);
}

bool is_of_the_machine(const std::exception& error) {
    if (is_out_of_memory(error)) return true;
    const auto* const system = dynamic_cast<const std::system_error*>(&error);
    if (system == nullptr) return false;
    const auto& reason = system->code();
    return is_full(reason) || reason == std::errc::file_too_large || reason == std::errc::io_error ||
           reason == std::errc::read_only_file_system || reason == std::errc::permission_denied;
}

std::string failure_sentence(const std::exception& error, bool may_move) {
    if (const auto* file = dynamic_cast<const std::filesystem::filesystem_error*>(&error))
        return one_sentence(
                   fmt::format("cannot use '{}': {}", file->path1().string(), file->code().message())) +
               remedy_of(file->code(), may_move);
    if (const auto* system = dynamic_cast<const std::system_error*>(&error))
        return one_sentence(system->what()) + remedy_of(system->code(), may_move);
    if (!is_out_of_memory(error)) return one_sentence(text_of(error));
    return "there is not enough memory; free some, or ask for less: smaller batches, networks, rollouts or "
           "replay, fewer games at once";
}

}  // namespace cale
