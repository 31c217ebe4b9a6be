"""Check what the paper says, claim by claim, against this robot; the same as ``python -m scripts.paper``.

python scripts/reproduce_paper.py geometry [--poses 10000] [--seed 2022] [--layout paper] [--out FOLDER]
python scripts/reproduce_paper.py thermal [--draws 8] [--seed 2022] [--layout paper] [--out FOLDER]
python scripts/reproduce_paper.py sections [--seed 2022] [--layout paper] [--out FOLDER]
python scripts/reproduce_paper.py readings [--seed 2022] [--out FOLDER]
"""

from scripts.paper.__main__ import app

if __name__ == "__main__":
    app(prog_name="reproduce_paper.py")
