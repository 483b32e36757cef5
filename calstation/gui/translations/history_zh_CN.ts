<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>Filters</name>
    <message>
        <source>the latest {0} runs</source>
        <translation>最近 {0} 次</translation>
    </message>
    <message>
        <source>runs: {0}</source>
        <translation>共 {0} 次</translation>
    </message>
    <message>
        <source>Search</source>
        <translation>查找</translation>
    </message>
    <message>
        <source>Serial number, date, product, operator</source>
        <extracomment>Choices of outcome, and of the number of past days; None for all. Columns hidden first if there is too little space: attempt, operator, product; the details also show them. Right-aligned columns of numbers: attempt, duration.</extracomment>
        <translation>序列号、日期、产品、操作员</translation>
    </message>
    <message>
        <source>Every outcome</source>
        <translation>全部结果</translation>
    </message>
    <message>
        <source>Any time</source>
        <translation>任何时间</translation>
    </message>
    <message>
        <source>Today</source>
        <translation>今天</translation>
    </message>
    <message>
        <source>Last {0} days</source>
        <translation>最近 {0} 天</translation>
    </message>
    <message>
        <source>Outcome</source>
        <translation>结果</translation>
    </message>
    <message>
        <source>Time</source>
        <translation>时间</translation>
    </message>
</context>
<context>
    <name>HistoryPage</name>
    <message>
        <source>Show all runs</source>
        <translation>显示全部</translation>
    </message>
    <message>
        <source>Runs, the latest first</source>
        <extracomment>Maximum number of runs listed.</extracomment>
        <translation>标定记录，最近的在前</translation>
    </message>
    <message>
        <source>Folder of this run</source>
        <translation>本次标定的文件夹</translation>
    </message>
    <message>
        <source>Copy the path</source>
        <translation>复制路径</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
    <message>
        <source>The runs could not be read</source>
        <translation>无法读取标定记录</translation>
    </message>
    <message>
        <source>The run was not closed</source>
        <translation>这次标定未能结束</translation>
    </message>
    <message>
        <source>No run matches</source>
        <translation>没有符合条件的记录</translation>
    </message>
    <message>
        <source>Search for less, or show every outcome and time.</source>
        <translation>请减少查找条件，或显示全部结果和任何时间。</translation>
    </message>
    <message>
        <source>Every run will be listed here</source>
        <translation>每次标定都会列在这里</translation>
    </message>
    <message>
        <source>Passed, failed, stopped, faulty and incomplete ones, with their results and logs. Start a run on the first page.</source>
        <translation>合格、不合格、停止、故障和未完成的标定，连同结果和数据记录。
请在第一页开始标定。</translation>
    </message>
</context>
<context>
    <name>RunDetails</name>
    <message>
        <source>and {0} more</source>
        <translation>另有 {0} 项</translation>
    </message>
    <message>
        <source>Outside its limits:</source>
        <translation>超出限差：</translation>
    </message>
    <message>
        <source>The run was stopped by the operator.</source>
        <translation>操作员停止了这次标定。</translation>
    </message>
    <message>
        <source>The run did not reach its end.</source>
        <translation>这次标定没有做完。</translation>
    </message>
    <message>
        <source>Started</source>
        <translation>开始时间</translation>
    </message>
    <message>
        <source>Duration</source>
        <translation>用时</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Attempt</source>
        <translation>次数</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Resumed from</source>
        <translation>接续自</translation>
    </message>
    <message>
        <source>Software</source>
        <translation>软件版本</translation>
    </message>
    <message>
        <source>Stages</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>Result</source>
        <translation>查看结果</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>查看记录</translation>
    </message>
    <message>
        <source>Folder</source>
        <translation>文件夹</translation>
    </message>
    <message>
        <source>Resume</source>
        <translation>接着做</translation>
    </message>
    <message>
        <source>It can be resumed after its last completed stage, or closed.</source>
        <translation>可以从最后完成的阶段之后接着做，或就此结束。</translation>
    </message>
    <message>
        <source>It was closed and cannot be resumed.</source>
        <translation>已经结束，不能再接着做。</translation>
    </message>
    <message>
        <source>Close as incomplete</source>
        <translation>按未完成结束</translation>
    </message>
    <message>
        <source>Do not resume</source>
        <translation>不再接着做</translation>
    </message>
    <message>
        <source>No parameter was solved in this run</source>
        <translation>这次标定没有解算出参数</translation>
    </message>
    <message>
        <source>Show every parameter of this run</source>
        <translation>显示这次标定的全部参数</translation>
    </message>
    <message>
        <source>The log is no longer there</source>
        <translation>数据记录已不在原处</translation>
    </message>
    <message>
        <source>Draw the log and solve it again</source>
        <translation>查看数据曲线并离线解算</translation>
    </message>
    <message>
        <source>A run is going on; wait for its end</source>
        <translation>正在标定，请等它结束</translation>
    </message>
    <message>
        <source>Resume after the last completed stage</source>
        <translation>从最后完成的阶段之后继续</translation>
    </message>
    <message>
        <source>It is being closed</source>
        <translation>正在结束</translation>
    </message>
    <message>
        <source>The run keeps its outcome and can then no longer be resumed</source>
        <translation>结果不变，以后不能再接着做</translation>
    </message>
</context>
<context>
    <name>RunTable</name>
    <message>
        <source>Outcome</source>
        <translation>结果</translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
    <message>
        <source>Started</source>
        <translation>开始时间</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Attempt</source>
        <translation>次数</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Duration</source>
        <translation>用时</translation>
    </message>
    <message>
        <source>Stages</source>
        <translation>阶段</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
</context>
<context>
    <name>Trend</name>
    <message>
        <source>This unit&apos;s runs</source>
        <translation>该产品历次标定</translation>
    </message>
    <message>
        <source>Parameter</source>
        <extracomment>Maximum numbers of failed checks listed, of runs in the trend, and of dates on its axis. Vertical margin of the trend as a fraction of its range, and space for the first and last date per run.</extracomment>
        <translation>参数</translation>
    </message>
    <message>
        <source>The parameter over the unit&apos;s runs</source>
        <translation>该参数随历次标定的变化</translation>
    </message>
</context>
</TS>
