#include "report/html.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <stdexcept>

#include "report/csv.h"
#include "report/panel.h"
#include "report/report.h"
#include "report/run_folders.h"

namespace cale {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

class Html : public ::testing::Test {
  protected:
    Comparison comparison() const {
        for (const auto* agent : {"sac", "dqn<b>"}) {
            for (const std::uint64_t seed : {1, 2}) {
                folders_.run(fmt::format("runs/{}{}", agent[0], seed), agent, "Pong", seed, {-20, -10},
                             fmt::format("agent: {{gamma: {}}}\n", agent[0] == 's' ? 0.99 : 0.9));
                folders_.run(fmt::format("runs/{}_air{}", agent[0], seed), agent, "AirRaid", seed,
                             {400, 500});
            }
        }
        folders_.run("runs/broken", "sac", "Pong", 3, {});
        return compare(find_runs({folders_.path() / "runs"}, ScoreKind::training), {},
                       {.bootstrap = {.resamples = 100}, .group_by = {"agent"}});
    }

    test::RunFolders folders_{"html"};
    PageOrigin origin_{.command = "cale report 'a b' <x>", .version = "cale 0.1.0", .time = "2026-01-01"};
};

std::string read(const std::filesystem::path& path) {
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), {}};
}

TEST_F(Html, SaysAllThatAReaderNeeds) {
    const auto data = comparison();
    const auto html = to_html(data, figures(data), origin_);
    EXPECT_THAT(html, HasSubstr("<code>cale report 'a b' &lt;x&gt;</code>"));
    EXPECT_THAT(html, HasSubstr("cale 0.1.0 made this page"));
    EXPECT_THAT(html, HasSubstr("8 runs in 2 groups; 2 runs per game; aggregates over 1 game"));
    EXPECT_THAT(html, HasSubstr("AirRaid: there is no human score"));
    EXPECT_THAT(html, AllOf(HasSubstr("runs/broken: "), HasSubstr("no game of its training has ended")));
    EXPECT_THAT(html, HasSubstr("come out too narrow: dqn&lt;b&gt; (2); sac (2)."));
    EXPECT_THAT(html, HasSubstr("<th scope=\"col\">IQM</th>"));
    EXPECT_THAT(html, HasSubstr("<th scope=\"row\" class=\"name\">Pong</th>"));
    EXPECT_THAT(html, HasSubstr("100 resamples"));
    EXPECT_THAT(html, Not(HasSubstr("dqn<b>")));
    EXPECT_THAT(html, HasSubstr("<svg role=\"img\" aria-label=\""));
    EXPECT_THAT(html, Not(HasSubstr("<svg xmlns"))) << "a picture that a screen reader reads word by word";
}

TEST_F(Html, SaysWhatIsMissingAboveTheFigures) {
    const auto data = comparison();
    const auto html = to_html(data, figures(data), origin_);
    const auto box = html.substr(0, html.find("<svg"));
    EXPECT_THAT(box,
                AllOf(HasSubstr("Before you believe a figure"), HasSubstr("AirRaid: there is no human score"),
                      HasSubstr("runs/broken: no game of its training has ended")));
}

TEST_F(Html, NamesAgentProtocolActionSpaceAndSharedSettings) {
    const std::string settings =
        "env: {action_space: continuous, sticky_probability: 0.25, threshold: 0.7}\nagent: {tau: 0.005}\n";
    for (const std::uint64_t seed : {1, 2})
        folders_.run(fmt::format("runs/{}", seed), "sac", "Pong", seed, {-20, -10}, settings);
    const auto data = compare(find_runs({folders_.path() / "runs"}, ScoreKind::training), {},
                              {.bootstrap = {.resamples = 100}});
    const auto html = to_html(data, figures(data), origin_);
    for (const auto* cell : {">sac<", ">200M frames<", ">joystick, threshold 0.7<", ">agent.tau<", ">0.005<"})
        EXPECT_THAT(html, HasSubstr(cell));
    write_report(data, origin_, folders_.path() / "out");
    EXPECT_THAT(read(folders_.path() / "out/settings.tex"), HasSubstr("env.sticky\\_probability & 0.25"));
    EXPECT_THAT(read(folders_.path() / "out/setup.tex"), HasSubstr("sac & sac & 200M frames & joystick"));
}

TEST_F(Html, NamesTheSettingsThatTellTheGroupsOfAnAgentApart) {
    test::RunFolders folders("html_settings");
    for (const auto* atoms : {"1", "51"})
        folders.run(atoms, "sac", "Pong", 1, {-20},
                    fmt::format("agent: {{critic_atoms: {}, tau: 1}}\n", atoms));
    folders.run("der", "der", "Pong", 1, {-20}, "agent: {dueling: true}\n");
    const auto data =
        compare(find_runs({folders.path()}, ScoreKind::training), {}, {.bootstrap = {.resamples = 50}});
    const auto html = to_html(data, {}, origin_);
    EXPECT_THAT(
        html,
        HasSubstr("<th scope=\"row\" class=\"name\">agent.critic_atoms</th><td></td><td>1</td><td>51</td>"));
    EXPECT_THAT(html, AllOf(Not(HasSubstr("agent.tau")), Not(HasSubstr("agent.dueling"))));
}

TEST_F(Html, LinksToAFileOfEachFigureAndTable) {
    for (const std::uint64_t seed : {1, 2}) {
        folders_.run(fmt::format("runs/s{}", seed), "sac", "Pong", seed, {-20, -10});
        folders_.write(fmt::format("runs/s{}/joystick_events.csv", seed), "event,count\nUP,3\n");
        folders_.write(fmt::format("runs/s{}/eval/step_000000200_rewards.csv", seed),
                       "quantile,reward\n0,0\n1,7\n");
    }
    const auto data = comparison();
    const auto folder = folders_.path() / "out";
    write_report(data, origin_, folder);
    const auto html = read(folder / "report.html");
    std::size_t links = 0;
    for (auto at = html.find("href=\""); at != html.npos; at = html.find("href=\"", at + 1)) {
        const auto target = html.substr(at + 6, html.find('"', at + 6) - at - 6);
        if (target.starts_with('#')) continue;
        EXPECT_TRUE(std::filesystem::exists(folder / target)) << target;
        ++links;
    }
    EXPECT_GT(links, 0u);
    for (const auto& figure : figures(data))
        for (const auto* extension : {".svg", ".png", ".csv"})
            EXPECT_THAT(html, HasSubstr("href=\"" + figure.name + extension + "\"")) << figure.name;
    EXPECT_THAT(html, HasSubstr("href=\"rewards.csv\""));
}

TEST_F(Html, NeedsNothingFromElsewhere) {
    const auto data = comparison();
    auto html = to_html(data, figures(data), origin_);
    for (const auto* word : {"<script", "<link", "<img", "@import", "url("})
        EXPECT_THAT(html, Not(HasSubstr(word)));
    const std::string name = "xmlns=\"http://www.w3.org/2000/svg\"";  // a name, not a place
    for (auto at = html.find(name); at != html.npos; at = html.find(name)) html.erase(at, name.size());
    EXPECT_THAT(html, Not(HasSubstr("http")));
}

TEST_F(Html, AScriptIsOnThePageOnlyWhereItIsAskedFor) {
    const auto data = comparison();
    const auto plain = to_html(data, figures(data), origin_);
    const auto web = to_html(data, figures(data), origin_, /*with_script=*/true);
    for (const auto* word : {"<script", "data-series", "data-panel", "data-samples"}) {
        EXPECT_THAT(plain, Not(HasSubstr(word)));
        EXPECT_THAT(web, HasSubstr(word));
    }
    for (const auto* word : {"src=", "<link", "<img", "@import", "url(", "fetch("})
        EXPECT_THAT(web, Not(HasSubstr(word)));
    EXPECT_THAT(web, HasSubstr("<option data-colour=\"#0072b2\">dqn&lt;b&gt;</option>"));
    EXPECT_THAT(web, HasSubstr("data-panels=\"AirRaid,"));
}

TEST_F(Html, ACurveSaysWhatItsPointsStandFor) {
    Picture picture;
    const Panel panel{.left = 10, .top = 0, .right = 110, .bottom = 100, .x = {0, 100}, .y = {0, 10}};
    const auto before = extent_of(picture);
    draw_curve(picture, panel, {0, 50}, {{1, 0, 2}, {4, 3, 5}}, 1, /*with_band=*/true);
    assign_panel(picture, before, panel, "Pong");
    EXPECT_THAT(
        to_svg(picture, true),
        AllOf(HasSubstr("data-samples=\"0,1,0,2 50,4,3,5\" points=\"10.0,90.0 60.0,60.0\""),
              HasSubstr("data-series=\"1\" data-panel=\"0\""), HasSubstr("data-panels=\"Pong,10.0,0.0\"")));
    EXPECT_THAT(to_svg(picture), Not(HasSubstr("data-")));
}

TEST_F(Html, FiguresFollowLightAndDark) {
    const auto data = comparison();
    const auto html = to_html(data, figures(data), origin_);
    EXPECT_THAT(html, HasSubstr("prefers-color-scheme: dark"));
    EXPECT_THAT(html, HasSubstr("fill=\"var(--paper)\""));
    EXPECT_THAT(html, Not(HasSubstr("fill=\"#ffffff\"")));
}

TEST_F(Html, AReportIsAFolderOfFiles) {
    const auto data = comparison();
    const auto folder = folders_.path() / "out/report";
    const auto files = write_report(data, origin_, folder);
    EXPECT_EQ(files.front(), folder / "report.html");
    for (const auto& file : files) EXPECT_GT(std::filesystem::file_size(file), 40u) << file;
    for (const auto* name :
         {"aggregates.svg", "aggregates.png", "aggregates.csv", "game_curves.svg", "scores.csv"})
        EXPECT_TRUE(std::filesystem::exists(folder / name)) << name;
    EXPECT_THAT(read(folder / "report.html"), HasSubstr("</html>"));
    EXPECT_EQ(read_csv(folder / "performance_profiles.csv").rows.size(), 2 * data.thresholds.size());
    folders_.write("out/report/mine.csv", "a user's");
    const auto one_run = compare(find_runs({folders_.path() / "runs/s1"}, ScoreKind::training), {},
                                 {.bootstrap = {.resamples = 100}});
    const auto smaller = write_report(one_run, origin_, folder);
    EXPECT_LT(smaller.size(), files.size());
    for (const auto& file : files)
        EXPECT_EQ(std::filesystem::exists(file), std::ranges::find(smaller, file) != smaller.end()) << file;
    EXPECT_TRUE(std::filesystem::exists(folder / "mine.csv"));
    folders_.write("file", "");
    EXPECT_THROW(write_report(data, origin_, folders_.path() / "file"), std::exception);
    const std::filesystem::path own = folders_.write("mine/scores.csv", "a user's");
    EXPECT_THROW(write_report(data, origin_, folders_.path() / "mine"), std::runtime_error);
    EXPECT_EQ(read(own), "a user's");
    const std::filesystem::path notes = folders_.write("out/report/settings.md", "# What I think of it");
    EXPECT_THROW(write_report(data, origin_, folder), std::runtime_error);
    EXPECT_EQ(read(notes), "# What I think of it");
}

TEST_F(Html, APageThatNoReportWroteAndWhatIsBesideItStay) {
    const auto folder = folders_.path() / "notes";
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "report.html") << "<html>another program's</html>";
    std::ofstream(folder / "settings.svg") << "mine";
    EXPECT_THROW(write_report(comparison(), origin_, folder), std::runtime_error);
    EXPECT_EQ(read(folder / "report.html"), "<html>another program's</html>");
    EXPECT_EQ(read(folder / "settings.svg"), "mine");
}

TEST_F(Html, AFileThatALaterReportWouldRemoveStays) {
    const auto own = folders_.write("out/rewards.csv", "a user's");  // these runs have no rewards
    EXPECT_THAT([&] { write_report(comparison(), origin_, folders_.path() / "out"); },
                testing::ThrowsMessage<std::runtime_error>(
                    HasSubstr("rewards.csv is there and would be replaced, by this report or by another")));
    EXPECT_EQ(read(own), "a user's");
}

TEST_F(Html, AFileThatNoReportWritesStaysBesideEveryReport) {
    const auto own = folders_.write("out/scores.png", "a user's");  // reports have scores.csv alone
    for (int i = 0; i < 2; ++i) write_report(comparison(), origin_, folders_.path() / "out");
    EXPECT_EQ(read(own), "a user's");
}

TEST_F(Html, AFolderWhoseNameIsNotUtf8IsEscaped) {
    folders_.run("runs/caf\xe9\n", "sac", "Pong", 4, {});
    const auto data = comparison();
    EXPECT_THAT(to_html(data, figures(data), origin_), HasSubstr("runs/caf\\xe9\\x0a: "));
}

TEST_F(Html, AReportThatCannotBeWrittenLeavesTheEarlierOne) {
    const auto data = comparison();
    const auto folder = folders_.path() / "out";
    write_report(data, origin_, folder);
    const auto page = read(folder / "report.html");
    std::filesystem::remove(folder / "scores.csv");
    std::filesystem::create_directories(folder / "scores.csv/of a user");
    std::filesystem::create_directory(folder / ".partial-2147483647");  // of a report that was killed
    EXPECT_THROW(write_report(data, {.command = "another"}, folder), std::exception);
    EXPECT_EQ(read(folder / "report.html"), page);
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        EXPECT_FALSE(entry.path().filename().string().starts_with(".partial")) << entry.path();
}

}  // namespace
}  // namespace cale
