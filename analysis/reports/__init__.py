"""Reports: content (`build`, `document`, one module a section), drawings, and output (`html`, `pdf`)."""
