"""What no effect explains: one discrepancy, a sum of Gaussian processes over the conditions.

``processes`` says what moves by which condition and forms inner products, ``kernels`` the courses along a condition;
``process_sum`` fits one process or several beside a hypothesis; ``discrepancy`` asks for verdicts, sizes and rivals.
"""
