"""Everything people look at: tables, figures, pages, pictures, the methods paragraph."""
