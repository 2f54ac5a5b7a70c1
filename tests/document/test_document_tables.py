"""Every heading of a table says what it heads."""

from __future__ import annotations

from ravenjax.document.tables import with_scopes


def test_headings_get_their_scope():
    html = (
        "<table><thead><tr><th>a</th><th class='over'"
        ' colspan="2">b</th></tr></thead><tbody><tr><th'
        ' rowspan="3">x</th><td>1</td></tr></tbody><tfoot><tr><th>f</th></tr></tfoot></table>'
    )
    assert (
        with_scopes(html)
        == '<table><thead><tr><th scope="col">a</th><th scope="colgroup" class=\'over\''
        ' colspan="2">b</th></tr></thead><tbody><tr><th scope="rowgroup"'
        ' rowspan="3">x</th><td>1</td></tr></tbody><tfoot><tr><th'
        ' scope="col">f</th></tr></tfoot></table>'
    )
