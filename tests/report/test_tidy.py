"""Tables of a page lose what says nothing, and nothing else."""

from __future__ import annotations

from deltact_fab.report.templating import tidied


def table(*rows: str, attributes: str = "") -> str:
    return f"<p>before</p><table{attributes}>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>"


def test_columns_and_rows_of_dashes_go_and_one_dash_stays() -> None:
    page = tidied(
        table(
            "<th>a</th><th>b</th><th>c</th><th>d</th>",
            "<td>x</td><td>–</td><td class='n'>1</td><td></td>",
            "<td>y</td><td> - </td><td>–</td><td></td>",
            "<td>z</td><td><b>n.a.</b></td><td>2</td><td>–</td>",
            "<td>w</td><td></td><td>–</td><td><img src='data:,'></td>",
        )
    )
    assert "<th>b</th>" not in page
    assert "<thead>\n<tr><th>a</th><th>c</th><th>d</th></tr>\n</thead>" in page
    assert "<tr><td>x</td><td class='n'>1</td><td></td></tr>" in page
    assert "<td>y</td>" not in page  # it has a name and nothing else
    assert "<td>w</td><td>–</td><td><img src='data:,'></td>" in page  # a picture says something
    assert page.startswith("<p>before</p><table>")


def test_a_table_of_nothing_is_a_sentence() -> None:
    told = ' class="words" data-none="No contact &amp; no force."'
    rows = ("<th>a</th><th>b</th>", "<td>x</td><td>–</td>")
    assert tidied(table(*rows, attributes=told)).endswith(
        '<p class="soft">No contact &amp; no force.</p>'
    )
    assert "<table" not in tidied(table("<th>a</th>"))
    kept = tidied(table(rows[0], "<td>x</td><td>0</td>", attributes=told))
    assert '<table class="words"><' not in kept  # heads come first, on their own lines
    assert "data-none" not in kept


def test_a_head_over_two_columns_shrinks_with_them_and_titles_of_groups_stay() -> None:
    page = tidied(
        table(
            '<th rowspan="2">d</th><th colspan="2">seen</th>',
            "<th>1</th><th>2</th>",
            "<td>p</td><td>3</td><td>–</td>",
        )
    )
    assert '<tr><th rowspan="2">d</th><th>seen</th></tr>\n<tr><th>1</th></tr>' in page
    assert "<tr><td>p</td><td>3</td></tr>" in page
    groups = tidied(
        table("<th>a</th><th>b</th>", '<th colspan="2">group</th>', "<td>x</td><td>1</td>")
    )
    assert '</thead>\n<tbody>\n<tr><th colspan="2">group</th></tr>' in groups
    row = '<td>x</td><td colspan="2">none</td>'
    assert "<td>x</td><td>none</td>" in tidied(table("<th>a</th><th>b</th><th>c</th>", row))
    beside = tidied(table("<th>a</th><th>b</th><th>c</th>", row, "<td>y</td><td>–</td><td>2</td>"))
    assert "<th>b</th>" not in beside
    assert "<td>x</td><td>none</td>" in beside


def test_cells_of_a_stack_learn_their_heads() -> None:
    page = tidied(
        table(
            "<th></th><th>area, <i>mm²</i></th>",
            "<td>x</td><td>1</td>",
            attributes=' class="a stack"',
        )
    )
    assert '<td data-head="">x</td><td data-head="area, mm²">1</td>' in page
