"""Reports: one line per kind, with the first prim and a count."""

from encore.report import Reports, Severity


def test_one_line_per_kind_in_order() -> None:
    reports = Reports()
    reports.add("curves", "BasisCurves are not supported.", "/A")
    reports.error("mesh", "is not rendered: no points", "/M")
    reports.note("camera", "is used", "/C")
    reports.add("curves", "another message", "/B")
    reports.add("curves", "another message", "/B")
    assert reports.lines() == [
        "Warning: /A: BasisCurves are not supported (2 prims).",
        "Error: /M: is not rendered: no points.",
        "Note: /C: is used.",
    ]
    assert len(reports) == 3
    assert reports.count("curves") == 2 and reports.count("mesh") == 1 and reports.count("other") == 0


def test_errors() -> None:
    reports = Reports()
    reports.add("curves", "text", "/A")
    reports.note("camera", "text", "/A")
    assert not reports.has_errors
    reports.error("mesh", "text", "/A")
    assert reports.has_errors
    assert [(r.kind, r.severity) for r in reports.errors] == [("mesh", Severity.ERROR)]
