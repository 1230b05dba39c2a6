// How the tests of every agent's losses say that shapes which would broadcast are refused.
#pragma once

#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cale {

/// `make` returns a problem whose losses() can be computed. Called with a change that makes them impossible,
/// and with what the refusal must say: which tensor, the shape that it must have and the one it has.
template <class Make>
struct ExpectRefused {
    Make make;

    template <class Change>
    void operator()(const std::string& what, const std::string& expected, const std::string& given,
                    const Change& change) const {
        using testing::HasSubstr;
        auto problem = make();
        change(problem);
        EXPECT_THAT([&] { problem.losses(); }, testing::ThrowsMessage<std::invalid_argument>(testing::AllOf(
                                                   HasSubstr(what), HasSubstr(expected), HasSubstr(given))));
    }
};

}  // namespace cale
