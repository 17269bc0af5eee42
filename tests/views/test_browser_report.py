"""The report in a browser: filters, plots, keyboard, light and dark."""

import pytest
import report_work
from browsing import opened

from rsa_data.views.report.build import report

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    work = report_work.made(folder)
    return report(work, out=folder / "report.html").path.as_uri()


def shown(page) -> int:
    return page.locator(".card:visible").count()


def test_filters_leave_what_they_ask_for(address):
    with opened(address) as page:
        dialogs = []
        page.on("dialog", lambda dialog: dialogs.append(dialog.message))
        every = shown(page)
        assert page.locator("#shown").inner_text() == f"{every} of {every} samples shown"
        page.select_option("[name=dataset]", "rooms")
        assert shown(page) == every // 2
        page.select_option("[name=class]", report_work.EVIL)
        assert shown(page) == 2
        page.check("[name=failed]")
        assert shown(page) == 0
        page.get_by_role("button", name="Show all").click()
        page.wait_for_function(
            f"document.getElementById('shown').textContent.startsWith('{every} ')"
        )
        page.fill("[name=words]", "bed 3")
        assert shown(page) == 4
        page.fill("[name=words]", "no such words")
        assert page.locator("#shown").inner_text() == f"0 of {every} samples shown"
        assert dialogs == []


def test_plots_are_drawn_and_their_numbers_unfold_by_keyboard(address):
    with opened(address) as page:
        plot = page.locator("figure.plot").first
        box = plot.locator("svg[role=img]").bounding_box()
        assert box["width"] > 300 and box["height"] > 100
        assert plot.locator("rect.bar").count() > 0
        numbers = plot.locator("table")
        assert not numbers.is_visible()
        plot.locator("summary").focus()
        page.keyboard.press("Enter")
        assert numbers.is_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_stand_out_from_the_page(address, scheme):
    with opened(address, color_scheme=scheme) as page:
        for selector in ("p", ".axis", "summary", ".failure", "td"):
            ink, paper = page.evaluate(
                """selector => {
                  const e = document.querySelector(selector), s = getComputedStyle(e);
                  const ink = e.namespaceURI.endsWith("svg") ? s.fill : s.color;
                  let p = e;
                  while (p && /rgba\\(0, 0, 0, 0\\)/.test(getComputedStyle(p).backgroundColor))
                    p = p.parentElement;
                  return [ink, getComputedStyle(p).backgroundColor];
                }""",
                selector,
            )
            assert contrast(ink, paper) >= 4.5, selector


def contrast(one: str, other: str) -> float:
    """WCAG 2's contrast of two CSS colours."""

    def light(colour: str) -> float:
        channels = [int(c) / 255 for c in colour[colour.index("(") + 1 : -1].split(",")[:3]]
        linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((light(one), light(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_nothing_runs_over_the_edge_of_a_phone(address):
    with opened(address, viewport={"width": 390, "height": 800}) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
