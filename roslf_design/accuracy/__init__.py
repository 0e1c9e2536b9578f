"""How far every number can be trusted: what each method costs and errs, the choice among them, and the statement.

What measures the table, walks the hard cases and draws the diagrams is the study `studies/accuracy`.
"""
