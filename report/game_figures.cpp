#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <map>
#include <set>
#include <span>
#include <utility>

#include "cale/action.h"
#include "report/figures.h"
#include "report/learning_curve.h"
#include "report/panel.h"
#include "report/ranges.h"
#include "report/tables.h"

namespace cale {
namespace {

constexpr std::size_t kMostEventPanels = 4;

/// What the groups that have something to show of a game did on it.
struct GameRow {
    const Game* game = nullptr;
    std::vector<std::pair<std::size_t, const GameResult*>> results{};  // with the groups' numbers
};

/// The games that some group has something to show of, in alphabetical order.
template <class HasData>
std::vector<GameRow> rows_with(const Comparison& comparison, HasData&& has_data) {
    std::map<std::string_view, GameRow> rows;
    for (std::size_t group = 0; group < comparison.results.size(); ++group) {
        for (const auto& result : comparison.results[group].games) {
            if (!has_data(result)) continue;
            auto& row = rows[result.game->name];
            row.game = result.game;
            row.results.emplace_back(group, &result);
        }
    }
    return values_in(std::move(rows));
}

/// The labels by group, empty for a group that these rows have nothing of.
std::vector<std::string> labels_in(const std::vector<GameRow>& rows, const Comparison& comparison) {
    std::vector<std::string> labels(comparison.results.size());
    for (const auto& row : rows)
        for (const auto& [group, result] : row.results) labels[group] = comparison.results[group].label;
    return labels;
}

/// "2-5 runs per game", of the runs in these rows that have what `member` is.
template <class Data>
std::string runs_in(const std::vector<GameRow>& rows, Data Run::*member) {
    std::set<std::size_t> counts;
    const auto has = [&](const Run* run) { return !(run->*member).empty(); };
    for (const auto& row : rows)
        for (const auto& [group, result] : row.results)
            counts.insert(static_cast<std::size_t>(std::ranges::count_if(result->runs, has)));
    counts.erase(0);
    return runs_text(counts);
}

std::size_t drawn(const std::vector<std::string>& labels) {
    return labels.size() - static_cast<std::size_t>(std::ranges::count(labels, ""));
}

/// Panels in rows of up to four, the wider the fewer they are.
struct Grid {
    std::size_t count;
    double top = 0;
    double room = 16;  // to the right of a panel, in pixels

    std::size_t columns() const { return std::clamp<std::size_t>(count, 1, 4); }
    double cell_width() const { return columns() == 4 ? 262 : columns() == 3 ? 350 : 420; }
    double cell_height() const { return 40 + 0.6 * cell_width(); }
    double width() const { return static_cast<double>(columns()) * cell_width() + kMargin; }
    double bottom() const {
        const std::size_t rows = (count + columns() - 1) / columns();
        return top + static_cast<double>(rows) * cell_height();
    }
    /// Without its coordinate system.
    Panel panel(std::size_t index) const {
        const std::size_t row = index / columns(), column = index % columns();
        const double x = static_cast<double>(column) * cell_width();
        const double y = top + static_cast<double>(row) * cell_height();
        return {.left = x + 58,
                .top = y + 34,
                .right = x + cell_width() - room,
                .bottom = y + cell_height() - 30};
    }
};

void title_panel(Picture& picture, const Panel& panel, std::string_view title) {
    picture.write(std::string(title), {panel.left, panel.top - 10}, kInk, 12.5, Anchor::start, true);
}

/// Axes with so many ticks, a title, and what draw() draws, as the panel of a game.
template <class Draw>
void draw_panel(Picture& picture, const Panel& panel, std::string_view game, std::string_view title,
                int x_ticks, int y_ticks, Draw&& draw) {
    const auto before = extent_of(picture);
    draw_axes(picture, panel, x_ticks, y_ticks, 11);
    title_panel(picture, panel, title);
    draw();
    assign_panel(picture, before, panel, game);
}

/// "a", "b", ...: panels are too small for names.
std::string letter(std::size_t index) {
    return index < 26 ? std::string(1, static_cast<char>('a' + index)) : fmt::format("{}", index + 1);
}

/// By letter, those that leave the curves more than half of the panel; an unseen one is no lie, as the table
/// has all.
std::vector<ReferenceScore> references_in_sight(const std::vector<Baseline>& references, const Game& game,
                                                Interval curves) {
    std::vector<ReferenceScore> seen;
    const double span = curves.high - curves.low;
    for (std::size_t i = 0; i < references.size(); ++i) {
        const auto score = references[i].scores.find(game.name);
        if (score == references[i].scores.end()) continue;
        if (score->second > curves.low - span / 2 && score->second < curves.high + span / 2)
            seen.push_back({letter(i), score->second});
    }
    return seen;
}

/// Dashed lines straight across, their letters to the right of the panel; lines that are close to one another
/// share a place for theirs, which names the first four.
void draw_references(Picture& picture, const Panel& panel, std::vector<ReferenceScore> references) {
    constexpr double kSize = 10.5, kRow = 12;
    constexpr std::ptrdiff_t kMostLetters = 4;
    std::ranges::sort(references, std::ranges::greater(), &ReferenceScore::score);
    for (auto first = references.begin(); first != references.end();) {
        auto next = first;
        std::string letters;
        double last = panel.to_y(first->score), sum = 0;
        for (; next != references.end() && panel.to_y(next->score) - last < kRow; ++next) {
            last = panel.to_y(next->score);
            sum += last;
            if (next - first < kMostLetters) letters += (letters.empty() ? "" : " ") + next->label;
            picture.lines.push_back({{{panel.left, last}, {panel.right, last}}, kFaintInk, 1.2, true});
        }
        if (next - first > kMostLetters) letters += fmt::format(" +{}", next - first - kMostLetters);
        const double y = sum / static_cast<double>(next - first) + 0.35 * kSize;
        picture.write(letters, {panel.right + 5, y}, kFaintInk, kSize);
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
        picture.write(line, {kMargin, y}, kFaintInk, kSize);
    }
    return y - top;
}

/// Begins a picture with a title and a legend, and returns a grid below them for so many panels.
Grid begin_panels(Picture& picture, const std::string& title, const std::vector<std::string>& labels,
                  std::size_t count, const std::vector<Baseline>& references = {}) {
    Grid grid{count};
    picture = titled_picture(title, grid.width());
    grid.top = 52 + draw_legend(picture, labels, kMargin, picture.width - kMargin, 48);
    grid.top += draw_letter_key(picture, "dashed", mapped(references, &Baseline::name), grid.top);
    // For the letters of draw_references().
    grid.room += 10 * static_cast<double>(std::min<std::size_t>(references.size(), 5));
    return grid;
}

/// A bar per event and group, where each group that has a label has its place.
void draw_event_bars(Picture& picture, const Panel& panel,
                     const std::map<std::size_t, std::vector<double>>& shares,
                     const std::vector<std::string>& labels) {
    const double row = (panel.bottom - panel.top) / kEventCount;
    const double thickness = (row - 4) / static_cast<double>(drawn(labels));
    for (const double tick : fitting_ticks(panel, 4, 11)) {
        draw_grid_line_at_x(picture, panel, tick);
        picture.write(fmt::format("{:g}%", 100 * tick), {panel.to_x(tick), panel.bottom + 16}, kFaintInk, 11,
                      Anchor::middle);
    }
    for (std::size_t event = 0; event < kEventCount; ++event) {
        const double top = panel.top + row * static_cast<double>(event) + 2;
        double y = top - thickness;
        for (std::size_t group = 0; group < labels.size(); ++group) {
            if (labels[group].empty()) continue;
            y += thickness;
            const auto own = shares.find(group);
            if (own == shares.end()) continue;
            picture.areas.push_back(rectangle(panel.left, y, panel.to_x(own->second[event]), y + thickness,
                                              series_colour(group)));
            picture.areas.back().of.series = static_cast<int>(group);
        }
    }
    picture.lines.push_back({{{panel.left, panel.top}, {panel.left, panel.bottom}}, kFaintInk, 1});
}

/// "bands: 95 % bootstrap intervals of the mean, 2000 resamples", where there are any.
std::string interval_text(const Comparison& comparison, std::string_view shown_as,
                          const Bootstrap& bootstrap) {
    if (!comparison.has_interval_of_a_game()) return "no intervals, which need several runs of a game";
    return fmt::format("{}: {:g} % bootstrap intervals of the mean, {} resamples", shown_as,
                       100 * bootstrap.confidence, bootstrap.resamples);
}

struct EventPanel {
    std::string title{};
    std::string game{};                                   // none: the mean over several
    std::map<std::size_t, std::vector<double>> shares{};  // by group; by Event
};

/// A panel per game, or where that would be many, the mean over the games that all of so many groups have.
std::vector<EventPanel> event_panels(const std::vector<GameRow>& rows, std::size_t groups) {
    std::vector<EventPanel> panels;
    for (const auto& row : rows) {
        const std::string name(row.game->name);
        auto& panel = panels.emplace_back(EventPanel{name, name});
        for (const auto& [group, result] : row.results) panel.shares[group] = result->event_shares;
    }
    if (panels.size() <= kMostEventPanels) return panels;
    std::erase_if(panels, [&](const EventPanel& panel) { return panel.shares.size() < groups; });
    if (panels.empty()) return panels;
    EventPanel mean{.title = fmt::format("mean over {} games", panels.size())};
    for (const auto& panel : panels) {
        for (const auto& [group, shares] : panel.shares) {
            auto& sum = mean.shares[group];
            sum.resize(kEventCount);
            for (std::size_t event = 0; event < kEventCount; ++event)
                sum[event] += shares[event] / static_cast<double>(panels.size());
        }
    }
    return {mean};
}

}  // namespace

Picture game_curves_figure(const Comparison& comparison) {
    const auto rows =
        rows_with(comparison, [](const GameResult& result) { return result.curve.steps.size() > 1; });
    auto references = comparison.random_floors;
    std::ranges::move(published(comparison), std::back_inserter(references));
    Picture picture;
    const auto grid = begin_panels(picture, "Learning curves, game by game", labels_in(rows, comparison),
                                   rows.size(), references);
    for (std::size_t i = 0; i < rows.size(); ++i) {
        std::vector<double> values;
        Panel panel = grid.panel(i);
        for (const auto& [group, result] : rows[i].results) {
            for (const auto& [value, low, high] : result->curve.values)
                values.insert(values.end(), {value, low, high});
            panel.x.high = std::max(panel.x.high, result->curve.steps.back());
        }
        auto seen = references_in_sight(references, *rows[i].game, room_for(values));
        for (const auto& reference : seen) values.push_back(reference.score);
        panel.y = room_for(values);
        const auto name = rows[i].game->name;
        draw_panel(picture, panel, name, name, 3, 4, [&] {
            draw_references(picture, panel, std::move(seen));
            for (const auto& [group, result] : rows[i].results)
                draw_curve(picture, panel, result->curve.steps, result->curve.values, group,
                           result->has_interval());
        });
    }
    finish_picture(
        picture, grid.bottom(),
        fmt::format("score over agent steps; mean of the runs ({}); {}{}", runs_in(rows, &Run::scores),
                    interval_text(comparison, "bands", comparison.config.for_bands()),
                    references.empty() ? "" : "; dashed lines that are far from the curves are left out"));
    return picture;
}

Picture event_figure(const Comparison& comparison) {
    const auto rows =
        rows_with(comparison, [](const GameResult& result) { return !result.event_shares.empty(); });
    const auto labels = labels_in(rows, comparison);
    const auto panels = event_panels(rows, drawn(labels));
    const double row = std::max(16.0, 5 * static_cast<double>(drawn(labels)) + 4);
    const double names = 118, panel_width = panels.size() == 1 ? 520 : 200, between = 40;
    Picture picture = titled_picture(
        "Joystick events", kMargin + names + static_cast<double>(panels.size()) * (panel_width + between));
    const double top = 80 + draw_legend(picture, labels, kMargin, picture.width - kMargin, 48);
    const double bottom = top + row * kEventCount;
    double highest = 0.01;
    for (const auto& panel : panels)
        for (const auto& [group, shares] : panel.shares)
            highest = std::max(highest, *std::ranges::max_element(shares));
    for (std::size_t event = 0; event < kEventCount; ++event) {
        picture.write(std::string(event_name(static_cast<Event>(event))),
                      {kMargin + names - 8, top + row * (static_cast<double>(event) + 0.5) + 4}, kInk, 11,
                      Anchor::end);
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
    picture.write("where the joystick was", {left + 3 * kStep + 8, top + 27}, kFaintInk, 11);
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
        double width = widest(headings.back(), kSize, true);
        for (const auto& row : table.rows) width = std::max(width, text_width(row[column], kSize, true));
        rights.push_back(x + width);
        x += width + kGap;
    }
    Picture picture = titled_picture("Scores, game by game", x - kGap + kMargin);
    const auto write = [&](std::size_t column, const std::string& text, double y, bool bold) {
        if (text.empty()) return;
        picture.write(text, {column == 0 ? kMargin : rights[column], y}, kInk, kSize,
                      column == 0 ? Anchor::start : Anchor::end, bold);
    };
    for (std::size_t line = 0; line < height; ++line) {
        for (std::size_t column = 0; column < headings.size(); ++column) {
            const auto above = height - headings[column].size();  // headings end in one line
            if (line >= above)
                write(column, headings[column][line - above], kTop + kLine * static_cast<double>(line), true);
        }
    }
    double y = kTop + kLine * static_cast<double>(height - 1);
    picture.lines.push_back({{{kMargin, y + 7}, {rights.back(), y + 7}}, kFaintInk, 1});
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
        y += kRow;
        for (std::size_t column = 0; column < table.rows[i].size(); ++column)
            write(column, table.rows[i][column], y, table.best[i][column]);
        picture.lines.push_back({{{kMargin, y + 6}, {rights.back(), y + 6}}, kGrid, 1});
    }
    finish_picture(
        picture, y + 10,
        fmt::format("mean of the runs ({}); {}{}", runs_text_of_all_games(comparison),
                    interval_text(comparison, "brackets", comparison.config.bootstrap),
                    comparison.results.size() > 1 ? "; bold: the highest mean of the groups" : ""));
    return picture;
}

/// A panel per game and group: the parts of the agent steps in each of the joystick's zones, over the
/// training.
Picture zone_figure(const Comparison& comparison) {
    auto rows = rows_with(comparison, [](const GameResult& result) { return !result.zones.empty(); });
    rows.resize(std::min<std::size_t>(rows.size(), 6));
    const auto labels = labels_in(rows, comparison);
    struct Shown {
        std::string_view game;
        std::string title;
        const std::vector<ZoneRow>& zones;
    };
    std::vector<Shown> shown;
    for (const auto& [game, results] : rows) {
        for (const auto& [group, result] : results) {
            const auto which = drawn(labels) == 1 ? "" : ": " + letter(group);
            shown.push_back({game->name, std::string(game->name) + which, result->zones});
        }
    }
    constexpr std::size_t kMostPanels = 48;
    const auto panels = std::span(shown).first(std::min(shown.size(), kMostPanels));
    Grid grid{panels.size(), 100};
    auto picture = titled_picture("Zones of the joystick over the training", grid.width());
    draw_zone_key(picture, kMargin, 50);
    if (drawn(labels) > 1) grid.top += draw_letter_key(picture, "groups", labels, grid.top);
    for (std::size_t i = 0; i < panels.size(); ++i) {
        Panel panel = grid.panel(i);
        const auto& zones = panels[i].zones;
        panel.x = {0, zones.back().step};
        draw_panel(picture, panel, panels[i].game, panels[i].title, 3, 2,
                   [&] { draw_zones(picture, panel, zones); });
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
    const auto rows =
        rows_with(comparison, [](const GameResult& result) { return result.reward_quantiles.size() > 1; });
    Picture picture;
    const auto grid = begin_panels(picture, "Rewards of an agent step, by quantile",
                                   labels_in(rows, comparison), rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
        std::vector<double> rewards;
        for (const auto& [group, result] : rows[i].results)
            for (const auto& [quantile, reward] : result->reward_quantiles) rewards.push_back(reward);
        Panel panel = grid.panel(i);
        panel.y = room_for(rewards);
        const auto name = rows[i].game->name;
        draw_panel(picture, panel, name, name, 4, 4, [&] {
            for (const auto& [group, result] : rows[i].results) {
                const auto estimate = [](const RewardQuantile& of) {
                    return Estimate{of.reward, of.reward, of.reward};
                };
                draw_curve(picture, panel, mapped(result->reward_quantiles, &RewardQuantile::quantile),
                           mapped(result->reward_quantiles, estimate), group, false);
            }
        });
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
    const auto add_panels = [&](Figure figure) {  // unless nothing is to show in any
        if (!figure.picture.panels.empty()) all.push_back(std::move(figure));
    };
    add_panels({"game_curves", "Learning curves",
                "The score as each game counts it, over agent steps." + floor_sentence(comparison),
                game_curves_figure(comparison)});
    all.push_back(
        {"game_scores", "Scores by game",
         std::string("The score as each game counts it, beside the scores that it is normalised with.") +
             (comparison.results.size() == 1 ? ""
              : comparison.has_interval_of_a_game()
                  ? " The highest mean of the groups is bold; where intervals overlap, that means little."
                  : " The highest mean of the groups is bold; without intervals, that means little.") +
             floor_sentence(comparison),
         game_table_figure(comparison)});
    add_panels({"events", "Joystick events",
                fmt::format("What the agents ask of the joystick {}.",
                            comparison.config.score == ScoreKind::training ? "in all their training"
                                                                           : "when evaluated"),
                event_figure(comparison)});
    add_panels({"zones", "Zones over the training",
                "Where the agents held the joystick, from the beginning of the training to its end.",
                zone_figure(comparison)});
    add_panels({"rewards", "Rewards", "How rewards are distributed over the steps of an evaluation.",
                reward_figure(comparison)});
    return all;
}

}  // namespace cale
