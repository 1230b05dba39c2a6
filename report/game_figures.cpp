#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <functional>
#include <iterator>
#include <map>
#include <set>
#include <span>
#include <utility>

#include "cale/action.h"
#include "report/figures.h"
#include "report/panel.h"
#include "report/tables.h"

namespace cale {
namespace {

constexpr std::size_t kMostEventPanels = 4;

/// What each group did on one game; null where it did not play it.
struct GameRow {
    const Game* game = nullptr;
    std::vector<const GameResult*> results{};  // by group
};

/// The games that some group has something to show of, in alphabetical order.
template <class HasData>
std::vector<GameRow> rows_with(const Comparison& comparison, HasData&& has_data) {
    std::map<std::string_view, GameRow> rows;
    for (std::size_t i = 0; i < comparison.results.size(); ++i) {
        for (const auto& result : comparison.results[i].games) {
            if (!has_data(result)) continue;
            auto& row = rows[result.game->name];
            row.game = result.game;
            row.results.resize(comparison.results.size(), nullptr);
            row.results[i] = &result;
        }
    }
    std::vector<GameRow> sorted;
    sorted.reserve(rows.size());
    for (auto& [name, row] : rows) sorted.push_back(std::move(row));
    return sorted;
}

/// The labels by group, empty for a group that these rows have nothing of.
std::vector<std::string> labels_in(const std::vector<GameRow>& rows, const Comparison& comparison) {
    auto labels = labels_of(comparison);
    for (std::size_t group = 0; group < labels.size(); ++group)
        if (std::ranges::none_of(rows, [&](const GameRow& row) { return row.results[group] != nullptr; }))
            labels[group].clear();
    return labels;
}

/// "2-5 runs per game", of the runs in these rows that have what `member` is.
template <class Data>
std::string runs_in(const std::vector<GameRow>& rows, Data Run::*member) {
    std::set<std::ptrdiff_t> counts;
    for (const auto& row : rows) {
        for (const auto* result : row.results) {
            if (result == nullptr) continue;
            const auto has = [&](const Run* run) { return !(run->*member).empty(); };
            counts.insert(std::ranges::count_if(result->runs, has));
        }
    }
    counts.erase(0);
    if (counts.empty()) return "no runs";
    return runs_text(static_cast<std::size_t>(*counts.begin()), static_cast<std::size_t>(*counts.rbegin()));
}

std::int64_t drawn(const std::vector<std::string>& labels) {
    return std::ranges::count_if(labels, [](const std::string& label) { return !label.empty(); });
}

bool has_curve(const GameResult& result) {
    return result.curve.steps.size() > 1;
}
bool has_events(const GameResult& result) {
    return !result.event_shares.empty();
}
bool has_rewards(const GameResult& result) {
    return result.reward_quantiles.size() > 1;
}

/// Panels in rows of up to four, the wider the fewer they are.
class Grid {
  public:
    /// `room`: to the right of a panel, in pixels.
    Grid(std::size_t count, double top, double room = 16)
        : columns_(std::clamp<std::size_t>(count, 1, 4)),
          count_(count),
          top_(top),
          room_(room),
          cell_width_(columns_ == 4   ? 262
                      : columns_ == 3 ? 350
                                      : 420) {}

    double width() const { return static_cast<double>(columns_) * cell_width_ + kMargin; }
    double bottom() const {
        const std::size_t rows = (count_ + columns_ - 1) / columns_;
        return top_ + static_cast<double>(rows) * cell_height();
    }
    /// Without its coordinate system.
    Panel panel(std::size_t index) const {
        const std::size_t row = index / columns_, column = index % columns_;
        const double x = static_cast<double>(column) * cell_width_;
        const double y = top_ + static_cast<double>(row) * cell_height();
        return {.left = x + 58,
                .top = y + 34,
                .right = x + cell_width_ - room_,
                .bottom = y + cell_height() - 30};
    }

  private:
    double cell_height() const { return 40 + 0.6 * cell_width_; }

    std::size_t columns_;
    std::size_t count_;
    double top_;
    double room_;
    double cell_width_;
};

void title_panel(Picture& picture, const Panel& panel, std::string_view title) {
    picture.words.push_back(
        {std::string(title), {panel.left, panel.top - 10}, kInk, 12.5, Anchor::start, true});
}

/// Every line to compare with that a panel may show: random play, then the literature.
std::vector<Baseline> references_of(const Comparison& comparison) {
    auto references = comparison.random_floors;
    std::ranges::move(published(comparison), std::back_inserter(references));
    return references;
}

/// "a", "b", ...: panels are too small for names.
std::string letter(std::size_t index) {
    return index < 26 ? std::string(1, static_cast<char>('a' + index)) : fmt::format("{}", index + 1);
}

/// A score to compare with, and its letter.
struct Reference {
    double value = 0;
    std::string label{};
};

/// Those that leave the curves more than half of the panel; an unseen one is no lie, as the table has all.
std::vector<Reference> references_in_sight(const std::vector<Baseline>& references, const Game& game,
                                           Interval curves) {
    std::vector<Reference> seen;
    const double span = curves.high - curves.low;
    for (std::size_t i = 0; i < references.size(); ++i) {
        const auto score = references[i].scores.find(game.name);
        if (score == references[i].scores.end()) continue;
        if (score->second > curves.low - span / 2 && score->second < curves.high + span / 2)
            seen.push_back({score->second, letter(i)});
    }
    return seen;
}

/// Dashed lines straight across, their letters to the right of the panel; lines that are close to one another
/// share a place for theirs, which names the first four.
void draw_references(Picture& picture, const Panel& panel, std::vector<Reference> references) {
    constexpr double kSize = 10.5, kRow = 12;
    constexpr std::ptrdiff_t kMostLetters = 4;
    std::ranges::sort(references, std::ranges::greater(), &Reference::value);
    for (auto first = references.begin(); first != references.end();) {
        auto next = first;
        std::string letters;
        double last = panel.to_y(first->value), sum = 0;
        for (; next != references.end() && panel.to_y(next->value) - last < kRow; ++next) {
            last = panel.to_y(next->value);
            sum += last;
            if (next - first < kMostLetters) letters += (letters.empty() ? "" : " ") + next->label;
            picture.lines.push_back({{{panel.left, last}, {panel.right, last}}, kFaintInk, 1.2, true});
        }
        if (next - first > kMostLetters) letters += fmt::format(" +{}", next - first - kMostLetters);
        const double y = sum / static_cast<double>(next - first) + 0.35 * kSize;
        picture.words.push_back({letters, {panel.right + 5, y}, kFaintInk, kSize});
        first = next;
    }
}

/// "WHAT: a = name, b = name, ...", as panels are too small for names; an empty name is left out. Returns the
/// height in pixels below `top` that it takes.
double draw_letter_key(Picture& picture, const std::string& what, const std::vector<std::string>& names,
                       double top) {
    constexpr double kSize = 11, kRow = 15;
    if (names.empty()) return 0;
    std::vector<std::string> parts;
    for (std::size_t i = 0; i < names.size(); ++i)
        if (!names[i].empty()) parts.push_back(fmt::format("{} = {}", letter(i), names[i]));
    double y = top;
    for (const auto& line :
         wrapped(fmt::format("{}: {}", what, fmt::join(parts, ", ")), picture.width - 2 * kMargin, kSize)) {
        y += kRow;
        picture.words.push_back({line, {kMargin, y}, kFaintInk, kSize});
    }
    return y - top;
}

/// A picture with a title, a legend, and below them a grid for so many panels.
std::pair<Picture, Grid> small_multiples(const std::string& title, const std::vector<std::string>& labels,
                                         std::size_t count, const std::vector<Baseline>& references = {}) {
    Picture picture = titled_picture(title, Grid(count, 0).width());
    double top = 52 + draw_legend(picture, labels, kMargin, picture.width - kMargin, 48);
    std::vector<std::string> names;
    names.reserve(references.size());
    for (const auto& reference : references) names.push_back(reference.name);
    top += draw_letter_key(picture, "dashed", names, top);
    // For the letters of draw_references().
    const double room = 16 + 10 * static_cast<double>(std::min<std::size_t>(references.size(), 5));
    return {std::move(picture), Grid(count, top, room)};
}

/// Bars of the groups that have a label.
void draw_event_bars(Picture& picture, const Panel& panel, const std::vector<std::vector<double>>& shares,
                     const std::vector<std::string>& labels) {
    const double row = (panel.bottom - panel.top) / kEventCount;
    const double thickness = (row - 4) / static_cast<double>(drawn(labels));
    for (const double tick : fitting_ticks(panel, 4, 11)) {
        const double x = panel.to_x(tick);
        draw_grid_line_at_x(picture, panel, tick);
        picture.words.push_back(
            {fmt::format("{:g}%", 100 * tick), {x, panel.bottom + 16}, kFaintInk, 11, Anchor::middle});
    }
    for (std::size_t event = 0; event < kEventCount; ++event) {
        const double top = panel.top + row * static_cast<double>(event) + 2;
        double y = top - thickness;
        for (std::size_t group = 0; group < shares.size(); ++group) {
            if (labels[group].empty()) continue;
            y += thickness;
            if (shares[group].empty()) continue;
            picture.areas.push_back(rectangle(panel.left, y, panel.to_x(shares[group][event]), y + thickness,
                                              series_colour(group)));
            picture.areas.back().of.series = static_cast<int>(group);
        }
    }
    picture.lines.push_back({{{panel.left, panel.top}, {panel.left, panel.bottom}}, kFaintInk, 1});
}

/// "bands: 95 % bootstrap intervals of the mean, 2000 resamples", where there are any.
std::string interval_text(const Comparison& comparison, std::string_view shown_as, std::int64_t resamples) {
    if (!has_intervals(comparison)) return "no intervals, which need several runs of a game";
    return fmt::format("{}: {:g} % bootstrap intervals of the mean, {} resamples", shown_as,
                       100 * comparison.config.bootstrap.confidence,
                       std::min(comparison.config.bootstrap.resamples, resamples));
}

struct EventPanel {
    std::string title{};
    std::string game{};                         // none: the mean over several
    std::vector<std::vector<double>> shares{};  // by group and Event
};

/// A panel per game, or where that would be many, the mean over the games that all groups with a label have.
std::vector<EventPanel> event_panels(const std::vector<GameRow>& rows,
                                     const std::vector<std::string>& labels) {
    std::vector<EventPanel> panels;
    for (const auto& row : rows) {
        EventPanel panel{.title = std::string(row.game->name), .game = std::string(row.game->name)};
        for (const auto* result : row.results)
            panel.shares.push_back(result == nullptr ? std::vector<double>() : result->event_shares);
        panels.push_back(std::move(panel));
    }
    if (panels.size() <= kMostEventPanels) return panels;
    std::erase_if(panels, [&](const EventPanel& panel) {
        for (std::size_t group = 0; group < labels.size(); ++group)
            if (!labels[group].empty() && panel.shares[group].empty()) return true;
        return false;
    });
    if (panels.empty()) return panels;
    EventPanel mean{.title = fmt::format("mean over {} games", panels.size())};
    mean.shares.resize(labels.size());
    for (const auto& panel : panels) {
        for (std::size_t group = 0; group < labels.size(); ++group) {
            if (labels[group].empty()) continue;
            mean.shares[group].resize(kEventCount);
            for (std::size_t event = 0; event < kEventCount; ++event)
                mean.shares[group][event] += panel.shares[group][event] / static_cast<double>(panels.size());
        }
    }
    return {mean};
}

}  // namespace

Picture game_curves_figure(const Comparison& comparison) {
    const auto rows = rows_with(comparison, has_curve);
    const auto references = references_of(comparison);
    auto [picture, grid] = small_multiples("Learning curves, game by game", labels_in(rows, comparison),
                                           rows.size(), references);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        std::vector<double> values;
        double last_step = 1;
        for (const auto* result : rows[i].results) {
            if (result == nullptr) continue;
            for (const auto& [value, low, high] : result->curve.values)
                values.insert(values.end(), {value, low, high});
            last_step = std::max(last_step, result->curve.steps.back());
        }
        auto seen = references_in_sight(references, *rows[i].game, room_for(values));
        for (const auto& reference : seen) values.push_back(reference.value);
        Panel panel = grid.panel(i);
        panel.x = {0, last_step};
        panel.y = room_for(values);
        const auto before = extent_of(picture);
        draw_axes(picture, panel, 3, 4, 11);
        title_panel(picture, panel, rows[i].game->name);
        draw_references(picture, panel, std::move(seen));
        for (std::size_t group = 0; group < rows[i].results.size(); ++group) {
            const auto* result = rows[i].results[group];
            if (result != nullptr)
                draw_curve(picture, panel, result->curve.steps, result->curve.values, group,
                           result->runs.size() > 1);
        }
        assign_panel(picture, before, panel, rows[i].game->name);
    }
    finish_picture(
        picture, grid.bottom(),
        fmt::format("score over agent steps; mean of the runs ({}); {}{}", runs_in(rows, &Run::scores),
                    interval_text(comparison, "bands", kBandResamples),
                    references.empty() ? "" : "; dashed lines that are far from the curves are left out"));
    return picture;
}

Picture event_figure(const Comparison& comparison) {
    const auto rows = rows_with(comparison, has_events);
    const auto labels = labels_in(rows, comparison);
    const auto panels = event_panels(rows, labels);
    const double row = std::max(16.0, 5 * static_cast<double>(drawn(labels)) + 4);
    const double names = 118, panel_width = panels.size() == 1 ? 520 : 200, between = 40;
    Picture picture = titled_picture(
        "Joystick events", kMargin + names + static_cast<double>(panels.size()) * (panel_width + between));
    const double top = 80 + draw_legend(picture, labels, kMargin, picture.width - kMargin, 48);
    const double bottom = top + row * kEventCount;
    double highest = 0.01;
    for (const auto& panel : panels)
        for (const auto& shares : panel.shares)
            for (const double share : shares) highest = std::max(highest, share);
    for (std::size_t event = 0; event < kEventCount; ++event) {
        picture.words.push_back({std::string(event_name(static_cast<Event>(event))),
                                 {kMargin + names - 8, top + row * (static_cast<double>(event) + 0.5) + 4},
                                 kInk,
                                 11,
                                 Anchor::end});
    }
    for (std::size_t i = 0; i < panels.size(); ++i) {
        const double left = kMargin + names + static_cast<double>(i) * (panel_width + between);
        const Panel panel{.left = left,
                          .top = top,
                          .right = left + panel_width,
                          .bottom = bottom,
                          .x = {0, 1.05 * highest}};
        const auto before = extent_of(picture);
        title_panel(picture, panel, panels[i].title);
        draw_event_bars(picture, panel, panels[i].shares, labels);
        assign_panel(picture, before, panel, panels[i].game);
    }
    finish_picture(
        picture, bottom + 28,
        fmt::format("part of the agent steps of {} at which the event was chosen; mean over the runs ({})",
                    comparison.config.score == ScoreKind::training ? "all of each run's training"
                                                                   : "each run's newest evaluation",
                    runs_in(rows, &Run::event_shares)));
    return picture;
}

namespace {

/// Of kZones: the centre grey, diagonals paler than what lies between them.
constexpr std::array<Colour, kZones.size()> kZoneColours{{{0xd9, 0xdd, 0xe2},
                                                          {0xd5, 0x5e, 0x00},
                                                          {0xe8, 0xa8, 0x6a},
                                                          {0xe6, 0xc2, 0x29},
                                                          {0x8f, 0xd0, 0xb4},
                                                          {0x00, 0x9e, 0x73},
                                                          {0x7f, 0xb8, 0xdc},
                                                          {0x00, 0x72, 0xb2},
                                                          {0xb0, 0x8f, 0xc7}}};

/// Nine squares that lie as the joystick does, their upper left corner at (left, top).
void draw_zone_key(Picture& picture, double left, double top) {
    constexpr double kSquare = 13, kStep = kSquare + 2;
    // Column and row of each of kZones.
    constexpr std::array<std::pair<int, int>, kZones.size()> places{
        {{1, 1}, {2, 1}, {2, 0}, {1, 0}, {0, 0}, {0, 1}, {0, 2}, {1, 2}, {2, 2}}};
    for (std::size_t zone = 0; zone < kZones.size(); ++zone) {
        const double x = left + kStep * places[zone].first, y = top + kStep * places[zone].second;
        picture.areas.push_back(rectangle(x, y, x + kSquare, y + kSquare, kZoneColours[zone]));
    }
    picture.words.push_back({"where the joystick was", {left + 3 * kStep + 8, top + 27}, kFaintInk, 11});
}

/// One area on the other, from the centre upwards.
void draw_zones(Picture& picture, const Panel& panel, const std::vector<ZoneRow>& zones) {
    std::vector<double> below(zones.size(), 0);
    for (std::size_t zone = 0; zone < kZones.size(); ++zone) {
        std::vector<Point> outline, lower;
        double from = 0;  // each row stands for the steps since the one before
        for (std::size_t i = 0; i < zones.size(); ++i) {
            const double left = panel.to_x(from), right = panel.to_x(zones[i].step);
            for (const double x : {left, right}) lower.push_back({x, panel.to_y(below[i])});
            below[i] += zones[i].shares[zone];
            for (const double x : {left, right}) outline.push_back({x, panel.to_y(below[i])});
            from = zones[i].step;
        }
        outline.insert(outline.end(), lower.rbegin(), lower.rend());
        picture.areas.push_back({std::move(outline), kZoneColours[zone]});
    }
}

bool has_zones(const GameResult& result) {
    return !result.zones.empty();
}

/// game_table() as a picture.
Picture game_table_figure(const Comparison& comparison) {
    constexpr double kRow = 21, kLine = 15, kSize = 12, kGap = 22, kTop = 66, kHeading = 150;
    const auto table = game_table(comparison);
    std::vector<std::vector<std::string>> headings;  // line by line
    std::size_t height = 1;
    std::vector<double> rights;  // of the columns
    double x = kMargin;
    for (std::size_t column = 0; column < table.header.size(); ++column) {
        headings.push_back(wrapped(table.header[column], kHeading, kSize));
        height = std::max(height, headings.back().size());
        double width = 0;
        for (const auto& line : headings.back()) width = std::max(width, text_width(line, kSize, true));
        for (const auto& row : table.rows) width = std::max(width, text_width(row[column], kSize, true));
        rights.push_back(x + width);
        x += width + kGap;
    }
    Picture picture = titled_picture("Scores, game by game", x - kGap + kMargin);
    const auto write = [&](const std::vector<std::string>& row, double y, auto&& is_bold, Colour colour) {
        for (std::size_t column = 0; column < row.size(); ++column) {
            if (row[column].empty()) continue;
            const bool first = column == 0;
            picture.words.push_back({row[column],
                                     {first ? kMargin : rights[column], y},
                                     colour,
                                     kSize,
                                     first ? Anchor::start : Anchor::end,
                                     is_bold(column)});
        }
    };
    double y = kTop;
    for (std::size_t line = 0; line < height; ++line) {
        std::vector<std::string> row;
        for (const auto& heading : headings) {
            const auto above = height - heading.size();  // headings end in one line
            row.push_back(line < above ? "" : heading[line - above]);
        }
        y = kTop + kLine * static_cast<double>(line);
        write(
            row, y, [](std::size_t) { return true; }, kInk);
    }
    picture.lines.push_back({{{kMargin, y + 7}, {rights.back(), y + 7}}, kFaintInk, 1});
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
        y += kRow;
        write(
            table.rows[i], y, [&](std::size_t column) { return table.best[i][column]; }, kInk);
        picture.lines.push_back({{{kMargin, y + 6}, {rights.back(), y + 6}}, kGrid, 1});
    }
    finish_picture(
        picture, y + 10,
        fmt::format("mean of the runs ({}); {}{}", runs_text_of_all_games(comparison),
                    interval_text(comparison, "brackets", comparison.config.bootstrap.resamples),
                    comparison.results.size() > 1 ? "; bold: the highest mean of the groups" : ""));
    return picture;
}

/// A panel per game and group: the parts of the agent steps in each of the joystick's zones, over the
/// training.
Picture zone_figure(const Comparison& comparison) {
    auto rows = rows_with(comparison, has_zones);
    rows.resize(std::min<std::size_t>(rows.size(), 6));
    const auto labels = labels_in(rows, comparison);
    struct Shown {
        std::string_view game;
        std::string title;
        const std::vector<ZoneRow>& zones;
    };
    std::vector<Shown> shown;
    for (const auto& row : rows) {
        for (std::size_t group = 0; group < row.results.size(); ++group) {
            const auto which = drawn(labels) == 1 ? "" : ": " + letter(group);
            if (const auto* result = row.results[group]; result != nullptr)
                shown.push_back({row.game->name, std::string(row.game->name) + which, result->zones});
        }
    }
    constexpr std::size_t kMostPanels = 48;
    const auto panels = std::span(shown).first(std::min(shown.size(), kMostPanels));
    auto picture = titled_picture("Zones of the joystick over the training", Grid(panels.size(), 0).width());
    draw_zone_key(picture, kMargin, 50);
    const double key = drawn(labels) > 1 ? draw_letter_key(picture, "groups", labels, 100) : 0;
    const Grid grid(panels.size(), 100 + key);
    for (std::size_t i = 0; i < panels.size(); ++i) {
        Panel panel = grid.panel(i);
        const auto& [game, title, zones] = panels[i];
        panel.x = {0, zones.back().step};
        panel.y = {0, 1};
        const auto before = extent_of(picture);
        draw_axes(picture, panel, 3, 2, 11);
        title_panel(picture, panel, title);
        draw_zones(picture, panel, zones);
        assign_panel(picture, before, panel, game);
    }
    finish_picture(picture, grid.bottom(),
                   fmt::format("part of the agent steps since the point before, over agent steps; mean of "
                               "the runs ({}); six games at most{}",
                               runs_in(rows, &Run::zones),
                               panels.size() < shown.size()
                                   ? fmt::format(", the first {} of {} panels; the table has all",
                                                 panels.size(), shown.size())
                                   : ""));
    return picture;
}

/// A panel per game: the rewards of an agent step, by quantile.
Picture reward_figure(const Comparison& comparison) {
    const auto rows = rows_with(comparison, has_rewards);
    auto [picture, grid] =
        small_multiples("Rewards of an agent step, by quantile", labels_in(rows, comparison), rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
        std::vector<double> rewards;
        for (const auto* result : rows[i].results)
            if (result != nullptr)
                for (const auto& [quantile, reward] : result->reward_quantiles) rewards.push_back(reward);
        Panel panel = grid.panel(i);
        panel.y = room_for(rewards);
        const auto before = extent_of(picture);
        draw_axes(picture, panel, 4, 4, 11);
        title_panel(picture, panel, rows[i].game->name);
        for (std::size_t group = 0; group < rows[i].results.size(); ++group) {
            const auto* result = rows[i].results[group];
            if (result == nullptr) continue;
            std::vector<double> x;
            std::vector<Estimate> y;
            for (const auto& [quantile, reward] : result->reward_quantiles) {
                x.push_back(quantile);
                y.push_back({reward, reward, reward});
            }
            draw_curve(picture, panel, x, y, group, false);
        }
        assign_panel(picture, before, panel, rows[i].game->name);
    }
    finish_picture(picture, grid.bottom(),
                   "reward (vertical) that the given part of the agent steps (horizontal) of each run's "
                   "newest evaluation did not exceed; mean over the runs (" +
                       runs_in(rows, &Run::reward_quantiles) + ")");
    return picture;
}

/// Which random play is shown, where a group plays with the joystick.
std::string floor_sentence(const Comparison& comparison) {
    const auto of_joystick = [](const Baseline& floor) { return floor.name != kPublishedRandom; };
    if (std::ranges::none_of(comparison.random_floors, of_joystick)) return "";
    return " Runs with the continuous joystick compare with “random joystick”: uniformly random "
           "actions in polar or cartesian coordinates, as measured. “random (published)” is the literature's "
           "random agent, with discrete actions.";
}

}  // namespace

std::vector<Figure> game_figures(const Comparison& comparison) {
    std::vector<Figure> all;
    if (!rows_with(comparison, has_curve).empty()) {
        all.push_back({"game_curves", "Learning curves",
                       "The score as each game counts it, over agent steps." + floor_sentence(comparison),
                       game_curves_figure(comparison)});
    }
    all.push_back(
        {"game_scores", "Scores by game",
         std::string("The score as each game counts it, beside the scores that it is normalised with.") +
             (comparison.results.size() == 1 ? ""
              : has_intervals(comparison)
                  ? " The highest mean of the groups is bold; where intervals overlap, that means little."
                  : " The highest mean of the groups is bold; without intervals, that means little.") +
             floor_sentence(comparison),
         game_table_figure(comparison)});
    const auto with_events = rows_with(comparison, has_events);
    if (!event_panels(with_events, labels_in(with_events, comparison)).empty()) {
        all.push_back({"events", "Joystick events",
                       fmt::format("What the agents ask of the joystick {}.",
                                   comparison.config.score == ScoreKind::training ? "in all their training"
                                                                                  : "when evaluated"),
                       event_figure(comparison)});
    }
    if (!rows_with(comparison, has_zones).empty()) {
        all.push_back({"zones", "Zones over the training",
                       "Where the agents held the joystick, from the beginning of the training to its end.",
                       zone_figure(comparison)});
    }
    if (!rows_with(comparison, has_rewards).empty()) {
        all.push_back({"rewards", "Rewards", "How rewards are distributed over the steps of an evaluation.",
                       reward_figure(comparison)});
    }
    return all;
}

}  // namespace cale
