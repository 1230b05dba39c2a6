// The command lines of the small programs here: words in a fixed order.
#pragma once

#include <cstdint>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>
#include <string_view>

#include "cale/text.h"
#include "terminal/exit_code.h"

namespace bench {

using cale::kDone;
using cale::kFailed;
using cale::kUsage;  // for what the user wrote

/// The number that all of `text` is. Throws std::invalid_argument for another.
inline std::int64_t whole_number(const std::string& name, std::string_view text, std::int64_t least,
                                 std::int64_t most) {
    const auto number = cale::number_in<std::int64_t>(text);
    if (number && *number >= least && *number <= most) return *number;
    throw std::invalid_argument(name + " is '" + std::string(text) + "': give a whole number from " +
                                std::to_string(least) + " to " + std::to_string(most));
}

/// What `program` returns, `usage` beginning with its name. Answers --help; prints `usage` where it returns
/// kUsage, and one sentence for what it throws: a std::invalid_argument is the user's fault.
inline int run(const std::string& usage, int (*program)(int argc, char** argv), int argc, char** argv) {
    const std::string name = usage.substr(0, usage.find(' '));
    if (argc == 2 && std::string_view(argv[1]) == "--help") {
        std::printf("usage: %s\n", usage.c_str());
        return kDone;
    }
    try {
        const int code = program(argc, argv);
        if (code == kUsage) std::fprintf(stderr, "usage: %s\n", usage.c_str());
        return code;
    } catch (const std::invalid_argument& error) {
        std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
        return kUsage;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s: %s\n", name.c_str(), error.what());
        return kFailed;
    }
}

}  // namespace bench
