#include "evaluate/event_counts.h"

#include <stdexcept>

#include <gtest/gtest.h>

namespace cale {
namespace {

std::int64_t& count_of(EventCounts& counts, Event event) {
    return counts[static_cast<std::size_t>(event)];
}

TEST(EventCounts, SharesOfTheZonesAreThoseOfTheStepsBetween) {
    EventCounts before{};
    count_of(before, Event::noop) = 100;
    count_of(before, Event::left_fire) = 7;
    EventCounts now = before;
    count_of(now, Event::noop) += 2;
    count_of(now, Event::fire) += 1;
    count_of(now, Event::left) += 3;
    count_of(now, Event::left_fire) += 1;
    count_of(now, Event::down_right_fire) += 1;
    const auto shares = zone_shares(before, now);
    ASSERT_EQ(shares.size(), 10U);
    EXPECT_DOUBLE_EQ(shares.at("centre"), 3.0 / 8);
    EXPECT_DOUBLE_EQ(shares.at("left"), 4.0 / 8);
    EXPECT_DOUBLE_EQ(shares.at("down_right"), 1.0 / 8);
    EXPECT_DOUBLE_EQ(shares.at("fire"), 3.0 / 8);
    EXPECT_EQ(shares.at("up"), 0);
    EXPECT_TRUE(zone_shares(now, now).empty());
}

TEST(EventCounts, AStickThatMovesCountsItsFrames) {
    EventCounts counts{};
    StepResult result{.frames = 3, .event = static_cast<std::uint8_t>(Event::up)};
    result.frame_events = {static_cast<std::uint8_t>(Event::left), static_cast<std::uint8_t>(Event::noop),
                           static_cast<std::uint8_t>(Event::left)};
    count_events(counts, result);
    EXPECT_EQ(count_of(counts, Event::up), 1);
    EXPECT_EQ(count_of(counts, Event::left), 0);
    result.stick_moves = true;
    count_events(counts, result);
    EXPECT_EQ(count_of(counts, Event::up), 1);
    EXPECT_EQ(count_of(counts, Event::left), 2);
    EXPECT_EQ(count_of(counts, Event::noop), 1);
}

TEST(EventCounts, WhereNoFrameWasPlayedNothingCounts) {
    EventCounts counts{};
    count_events(counts, {.frames = 0, .event = static_cast<std::uint8_t>(Event::up)});
    EXPECT_EQ(counts, EventCounts{});
}

TEST(EventCounts, ANumberThatIsNoEventIsRefused) {
    EventCounts counts{};
    EXPECT_THROW(count_events(counts, {.event = kEventCount}), std::out_of_range);
    EXPECT_EQ(counts, EventCounts{});
}

TEST(EventCounts, EveryEventHasTheZoneOfItsName) {
    for (std::size_t i = 0; i < kEventCount; ++i) {
        EventCounts counts{};
        counts[i] = 1;
        std::string zone;
        for (const auto& [name, share] : zone_shares({}, counts))
            if (share == 1 && name != "fire") zone = name;
        auto letters = zone == "centre" ? "" : zone;
        std::erase(letters, '_');
        for (auto& letter : letters) letter = static_cast<char>(std::toupper(letter));
        if (zone_shares({}, counts).at("fire") == 1) letters += "FIRE";
        EXPECT_EQ(letters.empty() ? "NOOP" : letters, event_name(static_cast<Event>(i)));
    }
}

}  // namespace
}  // namespace cale
