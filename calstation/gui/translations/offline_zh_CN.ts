<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>ChannelButton</name>
    <message>
        <source>Channels</source>
        <extracomment>Channels of each plot, and the unit and decimals of their values.</extracomment>
        <translation>通道</translation>
    </message>
    <message>
        <source>Shows or hides channels of the log</source>
        <translation>显示或隐藏记录的通道</translation>
    </message>
    <message>
        <source>Gyro {0}</source>
        <translation>陀螺 {0}</translation>
    </message>
    <message>
        <source>Accelerometer {0}</source>
        <translation>加表 {0}</translation>
    </message>
    <message>
        <source>Outer axis</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>Inner axis</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>Temperature</source>
        <translation>温度</translation>
    </message>
</context>
<context>
    <name>Comparison</name>
    <message>
        <source>unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>run</source>
        <translation>在线</translation>
    </message>
    <message>
        <source>offline</source>
        <translation>离线</translation>
    </message>
    <message>
        <source>diff.</source>
        <translation>差值</translation>
    </message>
    <message>
        <source>in σ</source>
        <translation>差值/σ</translation>
    </message>
    <message>
        <source>Run</source>
        <translation>在线标定</translation>
    </message>
    <message>
        <source>Offline</source>
        <translation>离线解算</translation>
    </message>
    <message>
        <source>Difference</source>
        <translation>比较</translation>
    </message>
    <message>
        <source>The run&apos;s parameters and those solved offline</source>
        <translation>在线标定与离线解算的参数</translation>
    </message>
    <message>
        <source>Parameters and their sigmas are shown here once a range is solved.</source>
        <translation>解算完成后，这里显示各参数及其标准差。</translation>
    </message>
    <message>
        <source>No result: this run did not reach its end</source>
        <translation>没有结果：这次标定没有做完</translation>
    </message>
    <message>
        <source>The log holds no result of a run</source>
        <translation>记录中没有在线标定结果</translation>
    </message>
    <message>
        <source>Not solved yet</source>
        <translation>尚未解算</translation>
    </message>
    <message>
        <source>offline, outdated</source>
        <translation>离线（已过期）</translation>
    </message>
    <message>
        <source>Outdated: the range or the stages have changed; solve again</source>
        <translation>已过期：范围或阶段已改变，请重新解算</translation>
    </message>
    <message>
        <source>Solved as far as the data allow; some stages are not</source>
        <translation>已按现有数据解算，并非每个阶段都能解算</translation>
    </message>
    <message>
        <source>Solved; the log names no limits to compare with</source>
        <translation>已解算；记录中没有可比较的限差</translation>
    </message>
    <message>
        <source>Partial: inside the limits, but not all stages of the product were solved</source>
        <translation>部分：满足限差，但没有解算产品的全部阶段</translation>
    </message>
    <message>
        <source>Inside every limit of the product</source>
        <translation>各项都在产品限差之内</translation>
    </message>
    <message>
        <source>Outside the limits: {0} of {1} checks</source>
        <translation>超出限差：{1} 项检查中有 {0} 项</translation>
    </message>
    <message>
        <source>Identical bit for bit</source>
        <translation>逐位完全一致</translation>
    </message>
    <message>
        <source>Largest difference {0} σ, {1}</source>
        <translation>最大差值 {0} σ，{1}</translation>
    </message>
    <message>
        <source>{0}; beyond 3 σ: {1}</source>
        <translation>{0}；超过 3 σ 的有 {1} 项</translation>
    </message>
    <message>
        <source>From samples {0} to {1}, part of the log.</source>
        <translation>只解算了记录的一部分：采样点 {0} 至 {1}。</translation>
    </message>
    <message>
        <source>, </source>
        <translation>、</translation>
    </message>
    <message>
        <source>Stages solved: {0}.</source>
        <translation>解算的阶段：{0}。</translation>
    </message>
    <message>
        <source>Not determined by these data: {0} of {1} parameters, marked below.</source>
        <translation>{1} 个参数中有 {0} 个无法由这些数据确定，已在下表标出。</translation>
    </message>
</context>
<context>
    <name>Exports</name>
    <message>
        <source>Compressed CSV (*.csv.gz)</source>
        <translation>压缩 CSV (*.csv.gz)</translation>
    </message>
    <message>
        <source>Export the log</source>
        <translation>导出记录</translation>
    </message>
    <message>
        <source>The export failed</source>
        <translation>导出失败</translation>
    </message>
    <message>
        <source>Export the range</source>
        <translation>导出范围</translation>
    </message>
    <message>
        <source>Parameters as CSV (*.csv)</source>
        <translation>参数表 CSV (*.csv)</translation>
    </message>
    <message>
        <source>Written</source>
        <translation>已写入</translation>
    </message>
    <message>
        <source>Export the result</source>
        <translation>导出结果</translation>
    </message>
</context>
<context>
    <name>LogHead</name>
    <message>
        <source>Closer (+)</source>
        <translation>放大 (+)</translation>
    </message>
    <message>
        <source>Further away (−)</source>
        <translation>缩小 (−)</translation>
    </message>
    <message>
        <source>Bring the chosen range into view</source>
        <translation>显示所选范围</translation>
    </message>
    <message>
        <source>Bring the whole log into view (Home, or a double click)</source>
        <translation>显示整个记录（Home 键或双击）</translation>
    </message>
    <message>
        <source>Range</source>
        <translation>范围</translation>
    </message>
    <message>
        <source>All</source>
        <translation>全部</translation>
    </message>
    <message>
        <source>{0} samples, {1} Hz</source>
        <translation>{0} 个采样点，{1} Hz</translation>
    </message>
    <message>
        <source>gaps: {0}</source>
        <translation>中断 {0} 处</translation>
    </message>
    <message>
        <source>invalid samples: {0}</source>
        <translation>无效采样点 {0} 个</translation>
    </message>
    <message>
        <source>damaged rows: {0}</source>
        <translation>损坏的数据行 {0} 行</translation>
    </message>
</context>
<context>
    <name>LogPlot</name>
    <message>
        <source>outer</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>inner</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>Gyro, °/s</source>
        <translation>陀螺，°/s</translation>
    </message>
    <message>
        <source>Accelerometer, m/s²</source>
        <translation>加表，m/s²</translation>
    </message>
    <message>
        <source>Table, °</source>
        <translation>转台，°</translation>
    </message>
    <message>
        <source>Temperature, °C</source>
        <translation>温度，°C</translation>
    </message>
    <message>
        <source>The log&apos;s curves</source>
        <extracomment>Height of the row of stage names, px. Margin beyond the ends of the log as a fraction of its length, so that a range edge there can be dragged. Ratio of the width of the view after zooming in to the width before. Number of samples merged into a drawn column; 1 if single samples are drawn.</extracomment>
        <translation>记录曲线</translation>
    </message>
</context>
<context>
    <name>OfflinePage</name>
    <message>
        <source>This log cannot be opened</source>
        <translation>无法打开这个记录</translation>
    </message>
    <message>
        <source>This range cannot be solved</source>
        <translation>这个范围无法解算</translation>
    </message>
    <message>
        <source>step {0}</source>
        <translation>第 {0} 步</translation>
    </message>
    <message>
        <source>Sample {0}</source>
        <translation>采样点 {0}</translation>
    </message>
    <message>
        <source>Another log can be opened when this job has ended or is cancelled.</source>
        <translation>等当前任务完成或取消后，才能打开另一个记录。</translation>
    </message>
    <message>
        <source>The range or the stages have changed: solve again first</source>
        <translation>范围或阶段已改变：请先重新解算</translation>
    </message>
    <message>
        <source>Open a log first</source>
        <translation>请先打开一个记录</translation>
    </message>
    <message>
        <source>The range holds no stage; widen it</source>
        <translation>所选范围内没有任何阶段，请扩大范围</translation>
    </message>
    <message>
        <source>Tick a stage to solve</source>
        <translation>请勾选要解算的阶段</translation>
    </message>
    <message>
        <source>Export range…</source>
        <translation>导出范围…</translation>
    </message>
    <message>
        <source>Solve the log first</source>
        <translation>请先解算</translation>
    </message>
    <message>
        <source>A stored log, drawn and solved again</source>
        <translation>查看数据记录并离线解算</translation>
    </message>
    <message>
        <source>Open a log…</source>
        <extracomment>Range and stages selected when the last solve was started, and when that of `solved` was.</extracomment>
        <translation>打开记录…</translation>
    </message>
    <message>
        <source>Reading the log</source>
        <translation>正在读取记录</translation>
    </message>
    <message>
        <source>Start offline solve</source>
        <translation>开始离线解算</translation>
    </message>
    <message>
        <source>Export result…</source>
        <translation>导出结果…</translation>
    </message>
    <message>
        <source>Export log…</source>
        <translation>导出记录…</translation>
    </message>
    <message>
        <source>Only the chosen samples; “Set to…” returns to the whole log</source>
        <translation>仅所选采样点；用“设为…”可恢复整个记录</translation>
    </message>
    <message>
        <source>Open a raw log (.h5) or a CSV with its TOML beside it, or drop the file here. Choose a range; the solver of the run solves it again, and both results are compared.</source>
        <translation>打开原始记录（.h5）或带同名 TOML 的 CSV，也可将文件拖到此处。选择区间后，用与运行时相同的解算程序重新解算，并比较两个结果。</translation>
    </message>
</context>
<context>
    <name>RangeBar</name>
    <message>
        <source>First sample</source>
        <extracomment>Number of stage check boxes in a row. Largest number up to which a double, the value type of the spin box, represents every integer.</extracomment>
        <translation>起始采样点</translation>
    </message>
    <message>
        <source>Last sample</source>
        <translation>结束采样点</translation>
    </message>
    <message>
        <source>Set to…</source>
        <translation>设为…</translation>
    </message>
    <message>
        <source>The whole log, or one of its stages</source>
        <translation>整个记录，或其中一个阶段</translation>
    </message>
    <message>
        <source>Whole log</source>
        <translation>整个记录</translation>
    </message>
    <message>
        <source>The first sample cannot be after the last: set to {0}.</source>
        <translation>起始采样点不能在结束采样点之后：已设为 {0}。</translation>
    </message>
    <message>
        <source>The last sample cannot be before the first: set to {0}.</source>
        <translation>结束采样点不能在起始采样点之前：已设为 {0}。</translation>
    </message>
    <message>
        <source>{0} is not in this log; it holds samples {1} to {2}.</source>
        <translation>{0} 不在此记录内；记录含采样点 {1} 至 {2}。</translation>
    </message>
</context>
<context>
    <name>SourceBar</name>
    <message>
        <source>Open a log</source>
        <translation>打开记录</translation>
    </message>
    <message>
        <source>Logs (*.h5 *.csv *.csv.gz)</source>
        <extracomment>File name endings of logs. Maximum number of recent logs, and of logs of the latest runs, in the menu.</extracomment>
        <translation>数据记录 (*.h5 *.csv *.csv.gz)</translation>
    </message>
    <message>
        <source>All files (*)</source>
        <translation>所有文件 (*)</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>记录</translation>
    </message>
    <message>
        <source>Path of a raw log (.h5) or of a CSV with its TOML beside it</source>
        <extracomment>A path that is unchanged for this interval, such as a pasted one, is opened if the file exists.</extracomment>
        <translation>原始记录（.h5）的路径，或旁边有 TOML 的 CSV 的路径</translation>
    </message>
    <message>
        <source>Open…</source>
        <translation>打开…</translation>
    </message>
    <message>
        <source>Recent</source>
        <translation>最近打开</translation>
    </message>
    <message>
        <source>Latest runs</source>
        <translation>最近的标定</translation>
    </message>
    <message>
        <source>No log has been opened here yet</source>
        <translation>这里还没有打开过记录</translation>
    </message>
</context>
<context>
    <name>StageChoice</name>
    <message>
        <source>The range holds no sample of this stage</source>
        <translation>所选范围内没有这个阶段的采样点</translation>
    </message>
</context>
</TS>
