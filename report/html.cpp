#include "report/html.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <string_view>
#include <utility>

#include "cale/text.h"
#include "report/panel.h"
#include "report/ranges.h"
#include "report/tables.h"

namespace cale {
namespace {

constexpr std::string_view kStyle = R"(
:root { --paper: #ffffff; --ground: #f6f7f9; --ink: #333a45; --strong: #14181f; --faint: #656d7a;
        --grid: #e6e9ed; --accent: #0072b2; --warn: #fff6e5; --warn-edge: #e69f00; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #191d23; --ground: #101318; --ink: #c9d0da; --strong: #f0f3f7; --faint: #949dab;
          --grid: #2c323b; --accent: #56b4e9; --warn: #2a2416; --warn-edge: #e69f00; }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink);
       font: 16px/1.55 system-ui, "Segoe UI", Helvetica, Arial, sans-serif; }
main { max-width: 1200px; margin: 0 auto; padding: 32px 20px 80px; }
h1 { color: var(--strong); font-size: 30px; line-height: 1.2; margin: 0 0 6px; }
h2 { color: var(--strong); font-size: 21px; margin: 48px 0 4px; }
p { margin: 6px 0 12px; max-width: 75ch; }
.faint { color: var(--faint); }
a { color: var(--accent); }
nav { margin: 18px 0; display: flex; flex-wrap: wrap; gap: 6px 18px; }
.card { background: var(--paper); border: 1px solid var(--grid); border-radius: 10px; padding: 14px 18px;
        overflow-x: auto; margin: 12px 0; width: fit-content; max-width: 100%; }
.card svg { display: block; }
.note { background: var(--warn); border-left: 4px solid var(--warn-edge); border-radius: 6px;
        padding: 10px 16px; margin: 18px 0; }
.note ul, .plain { margin: 4px 0; padding-left: 20px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 14.5px; }
caption { text-align: left; color: var(--faint); padding: 0 0 6px; }
th, td { padding: 5px 0 5px 20px; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--grid); }
th:first-child, td:first-child { padding-left: 0; }
.name { text-align: left; }
thead th { color: var(--strong); }
tbody th { font-weight: 400; }
tr:last-child td, tr:last-child th { border-bottom: 0; }
td.best { font-weight: 700; color: var(--strong); }
code { font: 13.5px/1.5 ui-monospace, Menlo, Consolas, monospace; overflow-wrap: anywhere; }
.tools { position: sticky; top: 0; z-index: 1; display: flex; flex-wrap: wrap; gap: 6px 8px; align-items: center;
         background: var(--ground); padding: 10px 0; border-bottom: 1px solid var(--grid); }
.tools button, .tools input { font: inherit; font-size: 14px; color: var(--ink); background: var(--paper); cursor: pointer;
         border: 1px solid var(--grid); border-radius: 7px; padding: 4px 10px; min-height: 32px; }
.tools input { cursor: text; margin-left: auto; }
.tools ~ h2 { scroll-margin-top: 60px; }
.tools button[aria-pressed="false"] { opacity: .5; text-decoration: line-through; }
.tools i { display: inline-block; width: 11px; height: 11px; border-radius: 3px; margin-right: 7px; }
.value { position: fixed; z-index: 2; pointer-events: none; background: var(--paper); color: var(--strong);
         border: 1px solid var(--faint); border-radius: 7px; padding: 5px 10px; font-size: 13.5px; white-space: pre-line;
         font-variant-numeric: tabular-nums; }
.hidden { display: none; }
@media print { body { background: none; } .card { border: 0; } nav, .tools { display: none; } }
)";

/// Neutral colours follow the page's.
std::string inline_svg(const Picture& picture, bool with_data) {
    const std::array<std::pair<Colour, std::string_view>, 4> themes{{{kPaper, "var(--paper)"},
                                                                     {kInk, "var(--ink)"},
                                                                     {kFaintInk, "var(--faint)"},
                                                                     {kGrid, "var(--grid)"}}};
    std::string svg = to_svg(picture, with_data);
    // One picture to a screen reader, not a hundred words; and a browser shows no title over the page's
    // values.
    const auto title = fmt::format("<title>{}</title>\n", escaped(picture.title));
    svg.erase(svg.find(title), title.size());
    svg.insert(svg.find(' '), fmt::format(" role=\"img\" aria-label=\"{}\"", escaped(picture.title)));
    for (const auto& [colour, variable] : themes) {
        const auto fixed = fmt::format("\"{}\"", to_hex(colour)), themed = fmt::format("\"{}\"", variable);
        for (auto at = svg.find(fixed); at != svg.npos; at = svg.find(fixed, at + themed.size()))
            svg.replace(at, fixed.size(), themed);
    }
    return svg;
}

std::string html_table(const Table& table, std::string_view caption) {
    std::string html =
        fmt::format("<div class=\"card\"><table>\n<caption>{}</caption>\n<thead><tr>", escaped(caption));
    for (std::size_t column = 0; column < table.header.size(); ++column)
        html +=
            fmt::format("<th scope=\"col\"{}>{}</th>", column < table.name_columns ? " class=\"name\"" : "",
                        escaped(table.header[column]));
    html += "</tr></thead>\n<tbody>\n";
    for (std::size_t i = 0; i < table.rows.size(); ++i) {
        html += "<tr>";
        for (std::size_t column = 0; column < table.rows[i].size(); ++column) {
            const auto text = escaped(table.rows[i][column]);
            html +=
                column < table.name_columns
                    ? fmt::format("<th scope=\"row\" class=\"name\">{}</th>", text)
                    : fmt::format("<td{}>{}</td>", table.is_bold(i, column) ? " class=\"best\"" : "", text);
        }
        html += "</tr>\n";
    }
    return html + "</tbody>\n</table></div>\n";
}

std::string html_list(const std::vector<std::string>& items) {
    const auto entry = [](const std::string& item) { return fmt::format("<li>{}</li>\n", escaped(item)); };
    return "<ul class=\"plain\">\n" + joined(mapped(items, entry), "") + "</ul>\n";
}

/// Long lists are folded, so that what is below the box stays in sight.
std::string html_note(const Note& note) {
    constexpr std::size_t kShown = 10;
    const auto text = escaped(note.text);
    if (note.items.empty()) return fmt::format("<li>{}</li>\n", text);
    if (note.items.size() <= kShown) return fmt::format("<li>{}\n{}</li>\n", text, html_list(note.items));
    return fmt::format("<li><details><summary>{}</summary>\n{}</details></li>\n", text,
                       html_list(note.items));
}

std::string note_box(const Comparison& comparison) {
    if (comparison.notes.empty()) return "";
    return fmt::format(
        "<div class=\"note\" id=\"notes\"><strong>Before you believe a "
        "figure</strong>\n<ul>\n{}</ul></div>\n",
        fmt::join(mapped(comparison.notes, html_note), ""));
}

/// "As files: a.svg, a.png", each a link.
std::string file_links(const std::vector<std::string>& files) {
    const auto link = [](const std::string& file) { return fmt::format("<a href=\"{0}\">{0}</a>", file); };
    return fmt::format("<p class=\"faint\">As files: {}</p>\n", fmt::join(mapped(files, link), ", "));
}

std::string heading(std::string_view id, std::string_view title) {
    return fmt::format("<h2 id=\"{}\">{}</h2>\n", id, escaped(title));
}

std::string figure_section(const Comparison& comparison, const Figure& figure, bool with_data) {
    std::string html =
        heading(figure.name, figure.title) + fmt::format("<p>{}</p>\n", escaped(figure.caption));
    if (figure.name == "game_scores") {
        html += html_table(game_table(comparison), comparison.has_interval_of_a_game()
                                                       ? "Mean of the runs [interval]"
                                                       : "Mean of the runs");
    } else {
        html += fmt::format("<div class=\"card\">{}</div>\n", inline_svg(figure.picture, with_data));
    }
    std::vector<std::string> files{figure.name + ".svg", figure.name + ".png", figure.name + ".csv"};
    if (std::ranges::find(kFiguresWithTable, figure.name) != kFiguresWithTable.end())
        files.insert(files.end(), {figure.name + ".tex", figure.name + ".md"});
    html += file_links(files);
    if (figure.name == "aggregates")
        html += html_table(aggregate_table(comparison), comparison.has_interval_of_aggregates()
                                                            ? "Human-normalised, estimate [interval]"
                                                            : "Human-normalised estimates");
    if (figure.name == "probability_of_improvement")
        html += html_table(improvement_table(comparison),
                           comparison.has_interval_of_a_pair() ? "Estimate [interval]" : "Estimates");
    return html;
}

std::string setup_section(const Comparison& comparison) {
    return heading("setup", "What was run") +
           html_table(setup_table(comparison),
                      "Groups of runs, which differ in game and seed only unless "
                      "the settings below say otherwise") +
           file_links({"setup.csv", "setup.tex", "setup.md", "scores.csv"});
}

std::string settings_section(const Comparison& comparison) {
    std::string html = heading("settings", "Settings");
    if (const auto differing = setting_table(comparison); !differing.rows.empty())
        html += html_table(differing,
                           "In which groups differ, of those that all groups or several of one agent have");
    if (const auto shared = shared_setting_table(comparison); !shared.rows.empty())
        html += html_table(shared, "That all runs share, or whose values all groups have");
    std::vector<std::string> files{"settings.csv"};
    if (!all_settings(comparison.groups).empty()) files.insert(files.end(), {"settings.tex", "settings.md"});
    return html + file_links(files);
}

std::string method_section(const Comparison& comparison, const PageOrigin& origin) {
    const auto& bootstrap = comparison.config.bootstrap;
    std::map<std::string, std::size_t> made_with;
    for (const auto& group : comparison.groups)
        for (const auto& run : group.runs)
            if (!run.made_with.empty()) ++made_with[run.made_with];
    std::vector<std::string> versions{origin.version + " made this page"};
    for (const auto& [version, count] : made_with)
        versions.push_back(fmt::format("{} made {}", version, counted(count, "run")));

    std::string html = heading("method", "How this was made");
    html += fmt::format("<div class=\"card\"><code>{}</code></div>\n", escaped(origin.command));
    html += html_list(versions);
    html += fmt::format(
        "<p>A run's score is {}. Human-normalised: (score − random) / (human − random), with the published "
        "random scores, also for runs with the continuous joystick, so that they can be compared with "
        "published ones. {} Definitions: Agarwal et al. 2021, “Deep Reinforcement Learning at the Edge of "
        "the Statistical Precipice”. The files *.csv beside this page hold every number.</p>\n",
        comparison.config.score == ScoreKind::training
            ? "the mean return of the games in the last tenth of its training, or in the last 250,000 agent "
              "steps if that is less, exploration included"
            : "the mean return of its newest evaluation; of several of one checkpoint, the one with the most "
              "games",
        comparison.has_interval_of_a_game()
            ? fmt::format(
                  "Intervals are {:g} % percentile intervals of a stratified bootstrap: {} resamples, {} for "
                  "the bands of curves and profiles, each drawing every game's runs with replacement, "
                  "seed {}.",
                  100 * bootstrap.confidence, bootstrap.resamples, comparison.config.for_bands().resamples,
                  bootstrap.seed)
            : "There are no intervals, which need several runs of a game.");
    return html;
}

std::string summary(const Comparison& comparison) {
    std::size_t runs = 0;
    for (const auto& group : comparison.groups) runs += group.runs.size();
    return fmt::format("{} in {}; {}; aggregates over {}", counted(runs, "run"),
                       counted(comparison.groups.size(), "group"), runs_text_of_all_games(comparison),
                       counted(comparison.games.size(), "game"));
}

/// report_page.js, with the groups that its buttons are for.
std::string script(const Comparison& comparison) {
    constexpr std::string_view kScript =
#include "report_page.inc"
        ;
    std::vector<std::string> groups;
    const auto labels = labels_of(comparison);
    for (std::size_t i = 0; i < labels.size(); ++i)
        groups.push_back(fmt::format("<option data-colour=\"{}\">{}</option>", to_hex(series_colour(i)),
                                     escaped(labels[i])));
    return fmt::format("<datalist id=\"groups\">{}</datalist>\n<script>\n{}</script>\n",
                       fmt::join(groups, ""), kScript);
}

}  // namespace

std::string to_html(const Comparison& comparison, const std::vector<Figure>& figures,
                    const PageOrigin& origin, bool with_script) {
    std::string html = fmt::format(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
        "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
        "<meta name=\"color-scheme\" content=\"light dark\">\n<title>CALE: {}</title>\n<style>{}</style>\n"
        "</head>\n<body>\n<main>\n<h1>{}</h1>\n<p class=\"faint\">{}. {}.</p>\n",
        escaped(joined(labels_of(comparison), " | ")), kStyle,
        "Runs on the Continuous Arcade Learning Environment", escaped(summary(comparison)),
        escaped(origin.time));
    if (!comparison.games.empty())
        html += fmt::format("<p class=\"faint\">Games in the aggregates: {}.</p>\n",
                            escaped(joined(mapped(comparison.games, &Game::name), ", ")));

    html += "<nav><a href=\"#setup\">What was run</a>";
    for (const auto& figure : figures)
        html += fmt::format("<a href=\"#{}\">{}</a>", figure.name, escaped(figure.title));
    html += "<a href=\"#settings\">Settings</a><a href=\"#method\">Method</a></nav>\n";

    html += note_box(comparison);
    html += setup_section(comparison);
    for (const auto& figure : figures) html += figure_section(comparison, figure, with_script);
    html += settings_section(comparison);
    html += method_section(comparison, origin);
    if (with_script) html += script(comparison);
    return html + "</main>\n</body>\n</html>\n";
}

}  // namespace cale
