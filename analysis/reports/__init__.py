"""Reports: their content (`build`, `content`, a file a section), the drawings, and how they are set (`html`, `pdf`)."""
