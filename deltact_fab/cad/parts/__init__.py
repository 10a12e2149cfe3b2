"""One file a part: `expect` states inequalities and closed forms, `build` makes the solid."""
