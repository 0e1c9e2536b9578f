"""Design reports: content as plain data, figures as functions on Axes, one self-contained HTML page."""

from .blocks import Bullets, Code, Figure, Paragraph, Report, Section, Statement, Statements, Table

__all__ = ["Bullets", "Code", "Figure", "Paragraph", "Report", "Section", "Statement", "Statements", "Table"]
